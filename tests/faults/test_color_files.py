# SPDX-License-Identifier: Apache-2.0
"""Files that OpenColorIO would open: what is no regular file of limited size is refused, and nothing waits."""

from __future__ import annotations

import os
import sys
import zipfile
from pathlib import Path

import pytest

from oiiotex.engine.color import transform_files
from oiiotex.engine.color.config import ColorConfig
from oiiotex.engine.errors import Error
from tests.conftest import oiiotex
from tests.faults import line_of

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="fifos and devices of POSIX")
CONFIG = """ocio_profile_version: 2
search_path: .:luts
roles: {default: raw, scene_linear: lin}
file_rules: [!<Rule> {name: Default, colorspace: default}]
displays: {d: [!<View> {name: v, colorspace: raw}]}
looks:
  - !<Look> {name: night, process_space: lin, transform: LOOK}
colorspaces:
  - !<ColorSpace> {name: raw, isdata: true}
  - !<ColorSpace> {name: lin}
  - !<ColorSpace> {name: graded, from_scene_reference: GRADED}
"""
CUBE = "LUT_3D_SIZE 2\n" + "".join(f"{n & 1} {n >> 1 & 1} {n >> 2}\n" for n in range(8))
MATRIX = "!<MatrixTransform> {offset: [0, 0, 0, 0]}"


def config(folder: Path, graded: str = MATRIX, look: str = MATRIX) -> Path:
    path = folder / "c.ocio"
    path.write_text(CONFIG.replace("GRADED", graded).replace("LOOK", look))
    return path


def lut(name: str) -> str:
    return f"!<FileTransform> {{src: {name!r}}}"


@pytest.fixture
def files(tmp_path: Path) -> Path:
    (tmp_path / "luts").mkdir()
    os.mkfifo(tmp_path / "luts" / "fifo.cube")
    (tmp_path / "good.cube").write_text(CUBE)
    with open(tmp_path / "long.cube", "wb") as file:
        file.truncate(200 << 20)
    (tmp_path / "folder.cube").mkdir()
    (tmp_path / "link.cube").symlink_to("/dev/zero")
    (tmp_path / "refers.ctf").write_text(
        '<ProcessList id="a" version="1.7"><Reference path="luts/fifo.cube"/></ProcessList>'
    )
    return tmp_path


BAD = ("fifo.cube", "luts/fifo.cube", "/dev/zero", "/dev/stdin", "link.cube", "long.cube", "folder.cube", "refers.ctf")


@pytest.mark.parametrize("name", BAD)
def test_a_config_with_such_a_lut_is_refused(files, name):
    group = f"!<GroupTransform> {{children: [{MATRIX}, {lut(name)}]}}"
    for path in (config(files, graded=lut(name)), config(files, look=lut(name)), config(files, graded=group)):
        with pytest.raises(Error, match=r"not a regular file|a folder|file too large: expected at most 64 MB"):
            ColorConfig(str(path))
    assert ColorConfig(str(config(files, graded=lut("good.cube")))).resolve("graded") == "graded"
    assert ColorConfig(str(config(files, graded=lut("missing.cube")))).resolve("lin") == "lin"


def test_context_variables_and_files_of_ops_count_too(files):
    path = config(files, graded=lut("${SHOT}.cube"))
    words = ["--create", "4x4", "3", "-o", "o.exr"]
    for op in (["--colorconvert:key=SHOT:value=fifo", "lin", "graded"], ["--ociofiletransform", "fifo.cube"]):
        done = oiiotex("--colorconfig", path, *words[:-2], *op, *words[-2:], cwd=files)
        assert "fifo.cube: not a regular file" in line_of(done)
    done = oiiotex("--colorconfig", path, *words, cwd=files, env={**os.environ, "SHOT": "fifo"})
    assert done.returncode == 0 or "fifo.cube: not a regular file" in line_of(done)
    good = ["--colorconvert:key=SHOT:value=good", "lin", "graded"]
    assert oiiotex("--colorconfig", path, *words[:-2], *good, *words[-2:], cwd=files).returncode == 0


def test_an_archive_of_gigabytes_is_refused(files, monkeypatch):
    with zipfile.ZipFile(files / "c.ocioz", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("config.ocio", CONFIG.replace("GRADED", MATRIX).replace("LOOK", MATRIX))
        archive.writestr("long.cube", bytes(3 << 20))
    assert ColorConfig(str(files / "c.ocioz")).resolve("lin") == "lin"
    monkeypatch.setattr(transform_files, "_MOST_ARCHIVE", 2 << 20)
    with pytest.raises(Error, match="its files take more than 2 MB"):
        ColorConfig(str(files / "c.ocioz"))


@pytest.mark.parametrize(
    "text",
    ["<a>" * 3000, "<a>" * 100 + "</a>" * 100, f"<{'x' * 5000}/>", f"<a b='{'x' * 5000}'><c?>1</d></a>"],
    ids=["unclosed", "deep", "long", "malformed"],
)
@pytest.mark.parametrize("name", ["a.cc", "a.clf", "a.cube"])
def test_xml_that_ends_opencolorio_is_refused(tmp_path, name, text):
    """OpenColorIO 2.5 ends with a segmentation fault on these, or refuses some by other names."""
    (tmp_path / name).write_text(f"<ProcessList id='a' compCLFversion='3'>{text}</ProcessList>")
    with pytest.raises(Error, match="XML"):
        transform_files._require(str(tmp_path / name), set())
    done = oiiotex("--create", "8x8", "3", "--ociofiletransform", tmp_path / name, "-o", tmp_path / "o.exr")
    assert done.returncode == 1 and "XML" in done.stderr, done
