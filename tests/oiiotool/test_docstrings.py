# SPDX-License-Identifier: Apache-2.0
"""Docstrings of the filters' functions: the sections of numpydoc, and examples that run."""

from __future__ import annotations

import doctest
import re

import pytest

from oiiotex import filters
from oiiotex.python.signatures import docstring
from tests import pictures
from tests.conftest import save

pytestmark = pytest.mark.usefixtures("few_places")
SECTIONS = ["Parameters", "Returns", "Other Parameters", "Raises", "Examples"]  # in numpydoc's order
every_filter = pytest.mark.parametrize("op", filters.OURS, ids=lambda op: op.name)


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """The files that the examples read."""
    folder = tmp_path_factory.mktemp("examples")
    stones = pictures.stained(pictures.pebbles(64, 64, 1))
    save(stones, folder / "photo.png")
    save(stones[..., :1], folder / "roughness.png", space="data")
    (folder / "statue.obj").write_text(pictures.cube_obj(0.5))
    return folder


@every_filter
def test_a_docstring_has_the_sections_of_numpydoc(op):
    text = getattr(filters, op.name).__doc__
    found = re.findall(r"\n\n(.+)\n-+\n", text)
    assert found == [one for one in SECTIONS if one in found] and {"Parameters", "Returns", "Raises"} <= set(found)
    assert "\n>>> from oiiotex import filters\n>>> " in text and f"filters.{op.name}(" in text.partition("Examples")[2]
    advanced = text.partition("Other Parameters\n")[2].partition("\n\n")[0]
    assert all(f"\n{p.attribute} : " in advanced for p in op.modifiers() if p.advanced)


@every_filter
def test_the_example_of_a_docstring_runs(op, files, tmp_path, monkeypatch):
    for file in files.iterdir():
        (tmp_path / file.name).symlink_to(file)
    monkeypatch.chdir(tmp_path)
    text = docstring(op).replace("96", "64").replace("48", "32").replace("k=-60", "k=-30")  # the sides of the photo
    text = text.replace('stationarize("photo.png"', 'stationarize("photo.png", iterations=4')
    text = text.replace("palette(photo", "palette(photo, panel=32")
    text = re.sub(r"(size=|np\.\w+\()\((\d+), (\d+)\)", r"\1(64, 48)", text)  # large ones take seconds
    said: list[str] = []
    test = doctest.DocTestParser().get_doctest(text, {}, op.name, None, None)
    assert test.examples and not doctest.DocTestRunner().run(test, out=said.append).failed, "".join(said)


def test_a_filter_of_another_package_has_an_example_without_declaring_one():
    class Plain(filters.op_named("lab")):
        name, example = "plain", ""

    assert docstring(Plain).endswith('>>> from oiiotex import filters\n>>> made = filters.plain("photo.png")')
