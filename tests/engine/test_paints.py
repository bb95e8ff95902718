# SPDX-License-Identifier: Apache-2.0
"""What people paint with: palettes for painting programs, names that reach Cryptomatte."""

from __future__ import annotations

import json
import struct

import numpy as np
import pytest

from oiiotex import filters
from oiiotex.engine import errors
from oiiotex.engine.core.label_map import LabelMap
from oiiotex.engine.io.cryptomatte import hashed
from oiiotex.engine.io.paint_palette import Swatch, write_palette
from oiiotex.engine.io.reading import read
from oiiotex.filters.texpalette import Palette
from oiiotex.oiiotool.cli.running.line_run import run
from tests import pictures
from tests.conftest import save
from tests.engine.test_label_map import part
from tests.synthesis.test_painting import photo


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """The palette of a photo with two levels of labels, and all that lies beside it."""
    folder = tmp_path_factory.mktemp("paints")
    for suffix in ("gpl", "aco"):
        filters.palette(photo(), panel=48, paints=folder / f"p.{suffix}", facts=folder / "p.json")
    return json.loads((folder / "p.json").read_text()), folder


def entries(facts) -> list[tuple[str, list[int]]]:
    rows = [*facts["labels"], *facts["finer"]]
    return [(entry["name"], [int(n) for n in entry["color"].split(",")]) for entry in rows]


def swatches(data: bytes) -> dict[int, list[tuple[str, list[int]]]]:
    """By version the colors of an .aco file, as Adobe's specification of the format says to read them."""
    lists, at = {}, 0
    while at < len(data):
        version, count = struct.unpack_from(">2H", data, at)
        at += 4
        lists[version] = []
        for _ in range(count):
            space, *values, last = struct.unpack_from(">5H", data, at)
            assert (space, last) == (0, 0)  # RGB
            at += 10
            name = ""
            if version == 2:
                (length,) = struct.unpack_from(">I", data, at)
                name = data[at + 4 : at + 4 + 2 * length].decode("utf-16-be")
                assert name.endswith("\0")
                at += 4 + 2 * length
            lists[version].append((name[:-1], [value // 257 for value in values]))
    return lists


def test_gimp_reads_colors_and_names(made):
    facts, folder = made
    lines = (folder / "p.gpl").read_text().splitlines()
    assert lines[:4] == ["GIMP Palette", "Name: p", "Columns: 0", "#"]
    found = [(name, [int(n) for n in color.split()]) for color, name in (line.split("\t") for line in lines[4:])]
    assert found == entries(facts)


def test_photoshop_reads_colors_and_names(made):
    facts, folder = made
    lists = swatches((folder / "p.aco").read_bytes())
    assert lists[2] == entries(facts)
    assert [color for _, color in lists[1]] == [color for _, color in entries(facts)]


def test_names_of_all_alphabets_and_none_that_breaks_a_line(tmp_path):
    paints = [Swatch("M\u00f6rtel \U0001f9f1", 1, 2, 255), Swatch("a\nb\tc", 0, 0, 0)]
    write_palette(tmp_path / "p.gpl", paints)
    lines = (tmp_path / "p.gpl").read_text().splitlines()[4:]
    assert lines == [f"  1   2 255\t{paints[0].name}", "  0   0   0\ta b c"]
    write_palette(tmp_path / "p.aco", paints)
    assert [name for name, _ in swatches((tmp_path / "p.aco").read_bytes())[2]] == ["M\u00f6rtel \U0001f9f1", "a b c"]


@pytest.mark.parametrize(("name", "said"), [("p.txt", r"expected \.gpl"), ("none/p.gpl", "no such folder")])
def test_a_palette_that_cannot_be_written_is_refused_before_the_work(tmp_path, monkeypatch, name, said):
    monkeypatch.setattr(Palette, "plan", pytest.fail)
    with pytest.raises(errors.ImageError, match=said):
        filters.palette(photo(), paints=tmp_path / name)


# --- names ---


def test_names_of_a_table_reach_parts_palettes_and_cryptomatte(tmp_path):
    save(pictures.stained(pictures.bricks(96, 96, seed=1)), tmp_path / "a.png")
    words = "a.png --texlabel:photo=1 -o l.exr l.exr --texpalette:panel=32:facts=t.json -o p.exr"
    assert run(words.split(), tmp_path) == 0
    table, name = json.loads((tmp_path / "t.json").read_text()), "moss & m\u00f6rtel"
    label = table["labels"][0]["id"]
    table["labels"][0]["name"] = name
    (tmp_path / "t.json").write_text(json.dumps(table))
    words = "a.png --texlabel:photo=1:palette=t.json:cryptomatte=1 -o n.exr n.exr --texpalette:facts=u.json -o q.exr"
    assert run(words.split(), tmp_path) == 0
    again = json.loads((tmp_path / "u.json").read_text())
    assert next(e["name"] for e in again["labels"] if e["id"] == label) == name
    spec = next(part.spec for part in read(tmp_path / "n.exr").parts if part.name == "cryptomatte")
    manifests = [json.loads(a.value) for a in spec.extra_attribs if a.name.endswith("/manifest")]
    (named,) = [m for m in manifests if name in m]
    assert named[name] == f"{hashed(name):08x}"
    assert f"label.{table['level']}/{label}" not in named


def naming(level: object, label: object, name: object) -> dict[str, object]:
    return {"level": level, "labels": [{"id": label, "name": name}]}


@pytest.mark.parametrize(
    ("table", "said"),
    [
        ({"255,0,0": 1}, "expected a table from --texpalette"),
        ([], "expected a table"),
        (naming([], 1, "x"), "expected a table"),
        (naming(1, 900, "x"), "label.1/900, which does not exist"),
        (naming(99, 1, "x"), "label.99/1, which does not exist"),
        (naming(1, 1, 7), "names that are strings"),
        (naming(1, True, "x"), "integer ids >= 1"),
    ],
)
def test_names_that_do_not_fit_are_refused(tmp_path, table, said):
    (tmp_path / "t.json").write_text(json.dumps(table))
    save(pictures.pebbles(64, 64, seed=1), tmp_path / "a.png")
    with pytest.raises(errors.Error, match=said):
        run(["a.png", "--texdecompose:palette=t.json", "-o", "l.exr"], tmp_path)


def test_names_that_a_file_brings_are_not_trusted():
    labels = LabelMap.of(part("label.1", np.array([[1, 2]])), 1, [(), ()])
    for text in ("{", "7", '[1, null, {"a": 1}]', "[" * 9999):
        stranger = LabelMap(labels.part.respecced(lambda spec, text=text: spec.attribute("oiiotex:names", text)), 1)
        assert [stranger.name(n) for n in (1, 2)] == ["label.1/1", "label.1/2"]
    assert labels.named({2: "b"}).name(2) == "b" and labels.named({2: "b"}).name(1) == "label.1/1"
