# SPDX-License-Identifier: Apache-2.0
"""What strangers can lay before the program: names and metadata that steer terminals, pipes, modules, programs."""

from __future__ import annotations

import contextlib
import logging
import os
import pty
import subprocess
import sys
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest

from oiiotex.engine.errors import Error
from oiiotex.oiiotool.cli.running.line_run import run
from tests.conftest import oiiotex, save

PROGRAM = Path(sys.executable).with_name("oiiotex")
STEERS = "a\x1b]0;x\x07\x1b[2J\u202eb\nc"


@pytest.fixture
def picture(tmp_path):
    return save(np.random.default_rng(1).random((24, 32, 3)), tmp_path / "a.png")


def on_a_terminal(folder: Path, *words: str) -> str:
    """What the program prints where standard output and error are a terminal."""
    ours, theirs = pty.openpty()
    process = subprocess.Popen([PROGRAM, *words], cwd=folder, stdin=theirs, stdout=theirs, stderr=theirs)
    os.close(theirs)
    pieces = []
    with contextlib.suppress(OSError):  # the other side is closed
        while piece := os.read(ours, 4096):
            pieces.append(piece)
    os.close(ours)
    process.wait(60)
    return b"".join(pieces).decode().replace("\r\n", "\n")


def test_metadata_and_names_do_not_steer_a_terminal(tmp_path, picture):
    buffer = oiio.ImageBuf(str(picture))
    buffer.specmod().attribute("ImageDescription", STEERS)
    name = f"{STEERS}.exr"
    assert buffer.write(str(tmp_path / name)), buffer.geterror()
    shown = on_a_terminal(tmp_path, "-v", "--info", name, "--echo", "{TOP[ImageDescription]}", "-o", "b.exr")
    assert "Reading " in shown and "\\x1b[2J\\u202eb" in shown
    assert all(character.isprintable() or character in "\n\t" for character in shown)
    refused = on_a_terminal(tmp_path, name, "--texlab", f"{STEERS}.png", "-o", f"{STEERS}/o.exr")
    assert refused.count("\n") == 1 and refused.strip("\n").isprintable() and "\\x1b" in refused


def test_a_log_is_as_a_pipe_of_oiiotool_has_it(tmp_path, picture):
    printed = oiiotex("-v", picture, "--echo", "\\033[31mred", "-o", tmp_path / "b.exr").stdout
    assert "\x1b[31mred\n" in printed


def test_errors_and_warnings_are_one_line(caplog):
    assert str(Error(STEERS)) == "a\\x1b]0;x\\x07\\x1b[2J\\u202eb c"
    from oiiotex.oiiotool.cli.running.line_run import _OneLine

    record = logging.LogRecord("oiiotex", logging.WARNING, "", 0, "%s is odd", (STEERS,), None)
    assert _OneLine().format(record) == "a\\x1b]0;x\\x07\\x1b[2J\\u202eb c is odd"


def test_a_message_does_not_repeat_a_damaged_file(tmp_path, picture):
    """OpenColorIO quotes the whole line that it does not understand."""
    (tmp_path / "bad.cube").write_text("LUT_3D_SIZE 2\n0 0 0" + " 1.5" * 100_000)
    done = oiiotex(picture, "--ociofiletransform", tmp_path / "bad.cube", "-o", tmp_path / "o.exr")
    assert done.returncode == 1 and done.stderr.count("\n") == 1 and len(done.stderr) < 2100
    assert str(tmp_path / "bad.cube") in done.stderr and " ... " in done.stderr


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no fifos here")
@pytest.mark.parametrize("line", [
    "pipe -o o.exr", "a.png --ociofiletransform pipe -o o.exr", "a.png --iccread pipe -o o.exr",
    "a.png --texquilt:mask=pipe -o o.exr", "a.png --texquilt:size=32x32 -o o.exr --texquilt:guide=pipe -o p.exr",
    "a.png --texpreview:exemplar=pipe -o o.exr",
])  # fmt: skip
def test_a_pipe_is_refused_and_not_waited_for(tmp_path, picture, line):
    os.mkfifo(tmp_path / "pipe")
    done = subprocess.run([PROGRAM, *line.split()], cwd=tmp_path, capture_output=True, text=True, timeout=60)
    assert done.returncode == 1 and done.stderr.endswith("pipe: not a regular file\n"), done.stderr
    assert not (tmp_path / "o.exr").exists()


def test_a_font_that_is_not_there_is_one_line_before_the_work(tmp_path, picture):
    done = oiiotex(picture, "--text:font=none.ttf", "hello", "-o", "o.exr", cwd=tmp_path)
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr == 'oiiotex ERROR: --text : Could not find font "none.ttf"\n'


def test_braces_in_the_name_of_a_transform_are_no_fault_of_ours(tmp_path, picture):
    with pytest.raises(Error, match="unmatched '}'"):
        run(["a.png", "--ociofiletransform", "}", "-o", "o.exr"], tmp_path)


def test_hints_for_readers_are_utf_8(tmp_path, picture):
    for hint in (("\udce9", "x"), ("x", "\udce9")):
        with pytest.raises(Error, match="is not UTF-8"):
            run(["--iconfig", *hint, "a.png", "-o", "o.exr"], tmp_path)


# --- modules and programs ---


def planted(folder: Path) -> Path:
    """Modules, programs and plugins in the current folder, named like all that is imported or started here."""
    mark = folder / "ran"
    names = {name.partition(".")[0] for name in sys.modules} - set(sys.builtin_module_names)
    names |= {"PIL", "yaml", "scipy", "sklearn", "tqdm", "pyopencl", "pocl_binary_distribution", "ziglang", "oiiotex"}
    for name in names:
        code = f"open({str(mark)!r}, 'a').write({name!r} + chr(10)); raise SystemExit(9)"
        (folder / f"{name}.py").write_text(code)
    for name in ("ld", "ld.lld", "cc", "gcc", "clang", "zig", "python", "python3", "git", "sh"):
        (folder / name).write_text(f"#!/bin/sh\necho {name} >> {mark}\n")
        (folder / name).chmod(0o755)
    (folder / "sitecustomize.py").write_text(f"open({str(mark)!r}, 'a').write('site')")
    (folder / "config.ocio").write_text("ocio_profile_version: 9\n")
    return mark


@pytest.mark.slow
def test_nothing_that_lies_in_the_current_folder_runs(tmp_path, picture):
    mark = planted(tmp_path)
    ignored = ("PYTHONSAFEPATH", "PYTHONPATH", "OIIOTEX_DEVICE", "OCIO")
    environment = {name: value for name, value in os.environ.items() if name not in ignored}
    environment |= {"XDG_CACHE_HOME": str(tmp_path / "cache")}  # the device is tried, and kernels are built and linked
    for line in (
        "a.png --texstationarize:iterations=1:size=24x24:report=r.json -o t.exr"
        " a.png --texsynth:size=16x16 -o s.exr --texzoom:size=16x16 -o f.exr"
        " a.png --texlabel:coarsest=none -o l.exr a.png --text hello --ociodisplay default default -o d.png",
        "--frames 1-2 --parallel-frames a.png --mulc 0.5 -o p.#.png",
        "--devices -v",
    ):
        done = subprocess.run([PROGRAM, *line.split()], cwd=tmp_path, env=environment, capture_output=True, text=True,
                              timeout=500)  # fmt: skip
        assert not mark.exists(), (line, mark.read_text())
        assert done.returncode == 0 or "ociodisplay" in line, (line, done.stderr)


@pytest.mark.parametrize(("kind", "text", "value"), [
    ("", "9" * 30, 2**31 - 1), ("", "-" + "9" * 5000, -(2**31)), (":type=int", "99999999999999", 2**31 - 1),
    (":type=int[2]", "99999999999999,1", (2**31 - 1, 1)),
])  # fmt: skip
def test_whole_numbers_end_at_32_bits_as_oiiotools(tmp_path, picture, kind, text, value):
    assert run(["a.png", f"--attrib{kind}", "foo", text, "-o", "o.exr"], tmp_path) == 0
    assert oiio.ImageBuf(str(tmp_path / "o.exr")).spec().getattribute("foo") == value
