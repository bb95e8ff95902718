# SPDX-License-Identifier: Apache-2.0
"""`--each`: one line for every file of a folder, in one run; names that collide are refused before the work."""

from __future__ import annotations

import logging
from pathlib import Path

import numpy as np
import pytest

from oiiotex.engine import errors
from oiiotex.oiiotool.cli.running.line_run import run
from tests import pictures
from tests.conftest import load, save


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Two pictures, one of the same name in another folder, and a broken file."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(logging.getLogger("oiiotex"), "level", logging.WARNING)  # which the program sets
    (tmp_path / "photos/more").mkdir(parents=True)
    (tmp_path / "out").mkdir()
    for number, name in enumerate(("a", "it's", "more/a")):
        save(pictures.noise(8, 8, number)[..., None], tmp_path / f"photos/{name}.png")
    (tmp_path / "photos/broken.png").write_bytes(b"no picture")
    return tmp_path


@pytest.mark.parametrize("parallel", [[], ["--parallel-frames"]])
def test_each_file_is_the_input_of_a_line_of_its_own(folder, caplog, parallel):
    line = ["--each", "photos/*.png", "--flip", "-o", "out/{name}.png"]
    assert run([*parallel, "--threads", "2", *line]) == 1  # of the broken one, which stops no other
    assert [path.name for path in sorted((folder / "out").iterdir())] == ["a.png", "it's.png"]
    for name in ("a", "it's"):
        np.testing.assert_array_equal(load(folder / f"out/{name}.png"), load(folder / f"photos/{name}.png")[::-1])
    assert [r.getMessage() for r in caplog.records] == [
        "oiiotex ERROR: photos/broken.png: cannot read the image: Not a PNG file"
    ]


def test_the_error_of_an_option_names_the_file(folder, caplog):
    save(np.zeros((8, 8, 4)), folder / "photos/b.png")
    assert run(["--each", "photos/[ab].png", "photos/b.png", "--over", "-o", "out/{name}.png"]) == 1
    (said,) = [record.getMessage() for record in caplog.records]
    assert said.startswith("oiiotex ERROR: photos/a.png: --over : images must have alpha")


def test_a_warning_names_its_file(folder, caplog):
    assert run(["--each", "photos/a.png", "--flip", "--ch", "Y,none", "-o", "out/{name}.png"]) == 0
    said = [record.getMessage() for record in caplog.records]
    assert "photos/a.png: no channel 'none' among Y: it is filled with 0" in said
    assert all(line.startswith("photos/a.png: ") for line in said)


def test_files_of_folders_keep_their_folder(folder):
    assert run(["--each", "photos/**/a.png", "--flip", "--create-dir", "-o", "out/{dir}/{name}.png"]) == 0
    assert sorted(str(path.relative_to(folder / "out")) for path in (folder / "out").rglob("*.png")) == [
        "photos/a.png", "photos/more/a.png",
    ]  # fmt: skip


def test_a_dry_run_prints_the_lines(folder, capsys):
    assert run(["-n", "--each", "photos/[ai]*.png", "--flip", "-o", "out/{name}.png"]) == 0
    assert capsys.readouterr().out.splitlines() == [
        "oiiotex photos/a.png --flip -o out/a.png",
        """oiiotex 'photos/it'"'"'s.png' --flip -o 'out/it'"'"'s.png'""",
    ]
    assert not list((folder / "out").iterdir())


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--each", "photos/**/a.png", "--flip", "-o", "out/{name}.png"],
         "out/a.png is an input or output of both photos/a.png and photos/more/a.png"),
        (["--each", "photos/[ai]*.png", "--flip", "-o", "photos/it's.png"], "photos/it's.png is an input or output of"),
        (["--each", "photos/[ai]*.png", "--texlabel:facts=out/x.json", "-o", "out/{name}.exr"],
         "out/x.json is an input or output of both"),
        (["--each", "photos/a.png", "--flip", "-o", "photos/{name}.{ext}"], "photos/a.png is the input; use another"),
        (["--each", "none/*", "-o", "x.png"], "no files match 'none/[*]'; quote the pattern"),
        (["--each", "photos/a.png", "--frames", "1-2", "-o", "out/{name}.png"], "cannot be combined with --frames"),
        (["--each", "photos/a.png", "-o", "out/{name}.%04d.png"], "cannot be combined with --frames"),
        (["--each", "photos/a.png", "--each", "photos/a.png", "-o", "out/{name}.png"], "--each is given twice"),
        (["--each", "a{b.png", "--echo", "{TOP.width}", "-o", "x.png"], "braces begin expressions"),
        (["--each", "a:b.png", "--texpreview:panels={name}", "-o", "x.png"], "cannot be part of '--texpreview"),
    ],
)  # fmt: skip
def test_what_cannot_be_done_is_refused_before_the_work(folder, words, says):
    for name in ("a{b.png", "a:b.png"):
        save(np.zeros((4, 4, 1)), folder / name)
    with pytest.raises(errors.Error, match=says):
        run(words)
    assert not list((folder / "out").iterdir())
