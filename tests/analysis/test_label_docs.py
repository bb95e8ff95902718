# SPDX-License-Identifier: Apache-2.0
"""What docs/reference/filters/texlabel.md says of reading a level back is true."""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest

from tests.analysis.test_label_parts import ids_of, parts_of
from tests.analysis.test_labels import quarters
from tests.conftest import load, oiiotex, save

PAGE = (Path(__file__).parents[2] / "docs" / "reference" / "filters" / "texlabel.md").read_text()


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    made = tmp_path_factory.mktemp("docs")
    assert oiio.ImageBuf(str(save(quarters(96)[0], made / "photo.png"))).write(str(made / "photo.jpg"))
    done = oiiotex("photo.jpg", "--texlabel:cryptomatte=1", "-o", "labels.exr", cwd=made)
    assert done.returncode == 0, done.stderr
    return made


def test_the_python_example_runs_and_reads_what_was_written(folder):
    (code,) = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
    print_it = "print(fine.dtype, fine.shape, areas.sum(), len(parents))"
    done = subprocess.run([sys.executable, "-c", code + print_it], cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    ids = ids_of(parts_of(folder / "labels.exr")["label.1"])
    assert done.stdout.split() == ["uint32", "(96,", "96)", str(96 * 96), str(ids.max())]


@pytest.mark.slow
def test_the_lines_that_take_a_level_out_work(folder):
    lines = [shlex.split(line, comments=True)[1:] for line in PAGE.splitlines() if "--subimage" in line]
    assert len(lines) == 3
    wanted = f"label.{len([n for n in parts_of(folder / 'labels.exr') if n.startswith('label.')])}"
    for words in lines:
        done = oiiotex(*(wanted if w == "label.3" else w for w in words), cwd=folder)
        assert done.returncode == 0, done.stderr
    np.testing.assert_array_equal(load(folder / "level3.tif")[..., 0], ids_of(parts_of(folder / "labels.exr")[wanted]))


def test_ids_asked_for_as_floats_are_divided(folder):
    part = parts_of(folder / "labels.exr")["label.1"]
    np.testing.assert_allclose(part.get_pixels(oiio.FLOAT)[..., 0] * (2.0**32 - 1), ids_of(part), rtol=1e-6)
