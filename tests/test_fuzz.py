# SPDX-License-Identifier: Apache-2.0
"""Nonsense of all kinds: what comes out is a result or an `oiiotex.Error`, never another exception."""

from __future__ import annotations

import contextlib
import io
import os
import random
import subprocess
import sys
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from oiiotex import filters, host
from oiiotex.cli.language import LANGUAGE
from oiiotex.cli.parse import Refused, parse, split_modifiers
from oiiotex.cli.running import run
from oiiotex.errors import Error, ParameterError
from oiiotex.params import declared
from tests.conftest import save

FUZZ = settings(
    max_examples=400,
    deadline=None,
    derandomize=True,
    database=None,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.function_scoped_fixture],
)

# --- modifiers ---


@FUZZ
@given(st.text("-:='\"{}ab 1,.\u00e9\udce9\n\t", max_size=40))
def test_any_word_splits_into_modifiers_or_is_refused(word):
    try:
        name, modifiers = split_modifiers(word)
    except ParameterError as error:
        assert word.split(":")[0] in str(error)
    else:
        assert all(modifiers) and ":" not in name.split("{")[0]


@FUZZ
@given(
    st.dictionaries(st.text("abc_1", min_size=1), st.text("ab:=., +-{}1\u00e9", max_size=12).map(str.strip), max_size=4)
)
def test_quoted_modifiers_come_back_as_they_were(modifiers):
    word = "--op" + "".join(f':{name}="{value}"' for name, value in modifiers.items())
    assert split_modifiers(word) == ("--op", modifiers)


# --- command lines ---

FILES = ["a.png", "b.exr", "one.exr", "none.png", "text.txt"]
OUTPUTS = ["o.exr", "o.png", "o.tif", "o.jpg", "o.%04d.exr", "o.banana", "none/o.exr", ".", ""]
# no image of a size that takes long; nothing that changes the process, or that computes on a device
LEFT_OUT = {
    "--device",
    "--devices",
    "--threads",
    "--parallel-frames",
    "--oiioattrib",
    "--completion",
    "--help",
    "--create-dir",
}
LEFT_OUT |= {"--while", "--for", "--endwhile", "--endfor", "--frames", "--cache", "--colorconfig", "--testread"}
VALUES = [
    "", "0", "1", "-1", "0.5", "1e39", "nan", "inf", "1,2,3", ",", "3x3", "4x5+1-2", "0x0", "-3x3", "9x", "50%", "+1+1",
    "1,1,2,2", "R,G,B", "A=1,R", "R=G", "float", "half", "uint8", "box", "gaussian", "black", "zip:99", "none",
    "ACEScg",
    "sRGB", "{TOP.width}", "{1+}", "{TOP.nonsense}", "{1/0}", "{", "}", "a b", "\u00e9\u65e5", "\udce9", "x" * 300,
    "%d", "%", "#", "@", "*", "(", "[", "\\", "'", '"',
]  # fmt: skip


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("fuzz")
    pixels = np.random.default_rng(0).random((9, 7, 4))
    save(pixels[..., :3], path / "a.png")
    save(pixels, path / "b.exr", "half", "ACEScg", x=-2, y=1, full_width=12, full_height=12)
    save(pixels[:1, :1], path / "one.exr", "float")
    (path / "text.txt").write_text("no image")
    return path


def options() -> list[tuple[str, int, list[str]]]:
    """Name, count of arguments, names of modifiers of all that may be tried."""
    found = []
    for op in (*host.OPS, *filters.FILTERS):
        if op.name.startswith("tex") and op.name not in ("texwarp",):
            continue
        found.append((op.flag(), len(op.arguments()), [p.name for p in op.modifiers()]))
    for option in LANGUAGE.options:
        if option.name in LEFT_OUT or option.name.startswith("-o"):
            continue
        names = [p.name for p in declared(option.modifiers)[1]] if option.modifiers else []
        found.append((option.name, len(option.arguments), names))
    found += [(refused.name, refused.arguments, []) for refused in LANGUAGE.refused]
    return found


@st.composite
def lines(draw: st.DrawFn) -> list[str]:
    words: list[str] = []
    for _ in range(draw(st.integers(1, 5))):
        kind = draw(st.integers(0, 9))
        if kind < 3:
            words.append(draw(st.sampled_from(FILES[:3])))
        elif kind == 3:
            words.append(draw(st.sampled_from([*FILES, *VALUES])))
        elif kind == 4:
            words += ["-o", draw(st.sampled_from(OUTPUTS))]
        else:
            name, count, modifiers = draw(st.sampled_from(options()))
            for _ in range(draw(st.integers(0, 2))):
                modifier = draw(st.sampled_from([*modifiers, *modifiers, "nonsense"]))
                name += f":{modifier}={draw(st.sampled_from(VALUES))}"
            words += [name, *(draw(st.sampled_from(VALUES)) for _ in range(count))]
    return [draw(st.sampled_from(FILES[:2])), *words, "-o", draw(st.sampled_from(OUTPUTS))]


@FUZZ
@given(lines())
def test_any_command_line_is_done_or_refused(folder, words):
    before = set(os.listdir(folder))
    try:
        with contextlib.redirect_stdout(io.StringIO()):
            run(words, folder)
    except Error as error:
        assert "\n" not in str(error)
    made = set(os.listdir(folder)) - before
    assert not [name for name in made if ".oiiotex-" in name]
    for name in made:
        (folder / name).unlink()


@FUZZ
@given(st.lists(st.one_of(st.text(max_size=12), st.sampled_from([name for name, _, _ in options()])), max_size=8))
def test_any_words_are_parsed_or_refused(words):
    try:
        command = parse(words, LANGUAGE)
    except Error as error:
        assert str(error)
    else:
        assert not any(
            isinstance(LANGUAGE.find(step.word.split(":")[0]), Refused) for step in command.steps if step.option
        )


# --- files ---

# (format, attributes) of small images that are broken at random
SEEDS = {
    "zip.exr": ("half", 3, {"compression": "zip"}),
    "piz.exr": ("float", 3, {"compression": "piz"}),
    "b44.exr": ("half", 4, {"compression": "b44"}),
    "dwaa.exr": ("half", 3, {"compression": "dwaa"}),
    "tiled.exr": ("half", 3, {"tile": 16}),
    "lzw.tif": ("uint8", 3, {"compression": "lzw"}),
    "jpeg.tif": ("uint8", 3, {"compression": "jpeg"}),
    "tiled.tif": ("float", 3, {"tile": 16, "compression": "zip"}),
    "a.png": ("uint8", 3, {}),
    "deep.png": ("uint16", 4, {}),
    "a.jpg": ("uint8", 3, {}),
    "a.hdr": ("float", 3, {}),
    "a.bmp": ("uint8", 3, {}),
    "a.tga": ("uint8", 4, {"compression": "rle"}),
    "a.dpx": ("uint16", 3, {}),
    "a.webp": ("uint8", 3, {}),
    "a.gif": ("uint8", 3, {}),
    "a.sgi": ("uint8", 3, {}),
    "a.ppm": ("uint8", 3, {}),
}
# where OpenImageIO itself ends with a signal: (name of the seed, number of the mutation): why that is tolerated
CRASHES: dict[tuple[str, int], str] = {}


def seed(path: Path, kind: str, channels: int, attributes: dict) -> bytes:
    spec = oiio.ImageSpec(23, 17, channels, kind)
    if side := attributes.get("tile"):
        spec.tile_width, spec.tile_height, spec.tile_depth = side, side, 1
    if "compression" in attributes:
        spec.attribute("compression", attributes["compression"])
    out = oiio.ImageOutput.create(str(path))
    if out is None:
        pytest.skip(f"this OpenImageIO does not write {path.suffix}")
    assert out.open(str(path), spec), out.geterror()
    places = np.add.outer(np.arange(17), np.arange(23))[..., None] * (3, 5, 2, 7)[:channels] % 256
    assert out.write_image((places / 255).astype(np.float32)), out.geterror()
    assert out.close()
    return path.read_bytes()


def broken(whole: bytes, number: int) -> bytes:
    """The file with bytes flipped, put in, taken out or cut off: mostly near its beginning, where headers are."""
    dice = random.Random(number)
    data = bytearray(whole)
    for _ in range(dice.choice((1, 1, 1, 2, 3, 5, 8))):
        at = dice.randrange(len(data)) if dice.random() < 0.4 else min(len(data) - 1, int(dice.expovariate(1 / 80)))
        kind = dice.random()
        if kind < 0.5:
            data[at] = dice.choice((0, 1, 127, 128, 255, dice.randrange(256), data[at] ^ 1 << dice.randrange(8)))
        elif kind < 0.7:
            words = (b"\xff\xff\xff\xff", b"\0\0\0\0", b"\x7f\xff\xff\xff", b"\xff\xff\xff\x7f", dice.randbytes(4))
            data[at : at + 4] = dice.choice(words)
        elif kind < 0.8:
            data[at:at] = dice.randbytes(dice.choice((1, 2, 4, 9)))
        elif kind < 0.9:
            del data[at : at + dice.choice((1, 2, 4, 9))]
        else:
            del data[at:]
        data = data or bytearray(b"\0")
    return bytes(data)


BATCH = """
import contextlib, io, os, sys
from oiiotex.cli.running import run
from oiiotex.errors import Error

log, output, *names = sys.argv[1:]
for name in names:
    with open(log, "a") as file:
        file.write(f"{name}\\n")
    try:
        with contextlib.redirect_stdout(io.StringIO()):
            run(["-q", name, "--info:verbose=1", "--stats", "-d", "float", "-o", output])
    except Error as error:
        assert "\\n" not in str(error), (name, str(error))
"""


def read_broken_ones(folder: Path, name: str, numbers: range) -> None:
    """In a process of its own: OpenImageIO or a library under it may crash."""
    whole = seed(folder / name, *SEEDS[name])
    files = []
    for number in numbers:
        if (name, number) not in CRASHES:
            files.append(folder / f"{number:04d}-{name}")
            files[-1].write_bytes(broken(whole, number))
    command = [sys.executable, "-c", BATCH, folder / "log", folder / "out.exr", *files]
    done = subprocess.run(
        [str(word) for word in command], capture_output=True, text=True, errors="replace", timeout=500
    )
    last = (folder / "log").read_text().splitlines()[-1]
    assert done.returncode == 0, (last, done.returncode, done.stderr[-2000:])
    assert not [path.name for path in folder.iterdir() if ".oiiotex-" in path.name]


@pytest.mark.parametrize("name", SEEDS)
def test_a_broken_file_is_read_or_refused(tmp_path, name):
    read_broken_ones(tmp_path, name, range(60))


@pytest.mark.slow
@pytest.mark.parametrize("name", SEEDS)
def test_many_broken_files_are_read_or_refused(tmp_path, name):
    read_broken_ones(tmp_path, name, range(60, 1000))
