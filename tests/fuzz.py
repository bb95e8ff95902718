# SPDX-License-Identifier: Apache-2.0
"""Nonsense by number: command lines, and files that are broken at random. `python -m tests.fuzz 100000` runs as many.

What a number stands for never changes with how many others are tried, so a number is all that a report needs.
"""

from __future__ import annotations

import argparse
import contextlib
import faulthandler
import functools
import io
import json
import os
import random
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import traceback
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import OpenImageIO as oiio

from oiiotex import filters
from oiiotex.engine.core.parameters import declared
from oiiotex.engine.errors import Error
from oiiotex.oiiotool import host
from oiiotex.oiiotool.cli.running.line_run import run
from oiiotex.oiiotool.cli.vocabulary import LANGUAGE
from tests import pictures
from tests.conftest import save

IMAGES = ("a.png", "b.exr", "one.exr", "photo.png", "labels.exr")
DOCUMENTS = ("text.txt", "graph.json", "table.json", "plan.npz", "folder")
OUTPUTS = ("o.exr", "o.png", "o.tif", "o.jpg", "o.tx", "o.%04d.exr", "o.banana", "none/o.exr", ".", "")
BESIDE = ("s.json", "s.exr", "s.npz", "s.gif", "s.mp4", "none/s.json", "a.png", "graph.json")
# what changes the process, would take a device or a thread pool of its own, or rightly never ends
_LEFT_OUT = {
    "--device", "--devices", "--threads", "--parallel-frames", "--oiioattrib", "--completion", "--help", "--create-dir",
    "--while", "--for", "--endwhile", "--endfor", "--colorconfig", "--testread", "--cache-clear",
}  # fmt: skip
VALUES = (
    "", "0", "1", "-1", "0.5", "2", "3", "8", "1e39", "nan", "inf", "1,2,3", ",", "3x3", "4x5+1-2", "0x0", "-3x3", "9x",
    "48x40", "32x24+5000-300", "50%", "+1+1", "1,1,2,2", "R,G,B", "A=1,R", "R=G", "float", "half", "uint8", "box",
    "gaussian", "black", "zip:99", "none", "ACEScg", "sRGB", "{TOP.width}", "{1+}", "{TOP.nonsense}", "{1/0}", "{", "}",
    "a b", "\u00e9\u65e5", "\udce9", "x" * 300, "a\nb", "\x1b[31m", "%d", "%", "#", "@", "*", "(", "[", "\\", "'", '"',
    "1-3", "1-3,7x2", "9" * 30, "seam>1.3", "seam>1.3,repeat>4", "seam>", "nonsense>1", "seed", "sigma", "color,data",
)  # fmt: skip
_SECONDS = 60  # that one case may take
_CHUNK = 400  # cases of one process


@functools.cache
def options() -> list[tuple[str, int, list[str]]]:
    """Name, count of arguments, names of modifiers of all that may be tried."""
    found = [(op.flag(), len(op.arguments()), [p.name for p in op.modifiers()])
             for op in (*host.OPS, *filters.FILTERS)]  # fmt: skip
    for option in LANGUAGE.options:
        if option.name in _LEFT_OUT or option.name.startswith("-o"):
            continue
        names = [p.name for p in declared(option.modifiers)[1]] if option.modifiers else []
        found.append((option.name, len(option.arguments), names))
    return found + [(refused.name, refused.arguments, []) for refused in LANGUAGE.refused]


def make_folder(path: Path) -> None:
    """What the lines name."""
    pixels = np.random.default_rng(0).random((9, 7, 4))
    save(pixels[..., :3], path / "a.png")
    save(pixels, path / "b.exr", "half", "ACEScg", x=-2, y=1, full_width=12, full_height=12)
    save(pixels[:1, :1], path / "one.exr", "float")
    save(pictures.stained(pictures.bricks(40, 48, seed=1)), path / "photo.png")
    with contextlib.redirect_stdout(io.StringIO()):
        run(["photo.png", "--texlabel:photo=1", "-o", "labels.exr"], path)
        run(["photo.png", "--texquilt:size=48x40:planfile=plan.npz", "-o", "quilt.exr", "-o", "tile.oiiotex"], path)
    (path / "text.txt").write_text("no image")
    (path / "graph.json").write_text(json.dumps({"exemplars": [{"id": "a", "file": "photo.png"}], "edges": []}))
    (path / "table.json").write_text(json.dumps({"255,0,0": 1, "0,255,0": [1, 2]}))
    (path / "folder").mkdir()


def line(number: int) -> list[str]:
    """The words of that command line."""
    dice = random.Random(number)
    words: list[str] = []
    for _ in range(dice.randint(1, 5)):
        kind = dice.randrange(10)
        if kind < 3:
            words.append(dice.choice(IMAGES))
        elif kind == 3:
            words.append(dice.choice((*IMAGES, *DOCUMENTS, *VALUES)))
        elif kind == 4:
            words += ["-o", dice.choice(OUTPUTS)]
        else:
            name, count, modifiers = dice.choice(options())
            for _ in range(dice.randrange(3)):
                modifier = dice.choice([*modifiers, *modifiers, "nonsense"])
                name += f":{modifier}={_value(dice)}"
            words += [name, *(_value(dice) for _ in range(count))]
    return [dice.choice(IMAGES), *words, "-o", dice.choice(OUTPUTS)]


def _value(dice: random.Random) -> str:
    kind = dice.randrange(10)
    return dice.choice(VALUES if kind < 7 else IMAGES if kind == 7 else DOCUMENTS if kind == 8 else BESIDE)


def do(words: list[str], folder: Path) -> None:
    """Run a line: it is done, or refused in one line of text, and leaves nothing half.

    Raises
    ------
    AssertionError
        That does not hold; and what else the line should not raise.
    """
    before = set(os.listdir(folder))
    try:
        with contextlib.redirect_stdout(io.StringIO()):
            run(words, folder)
    except Error as error:
        text = str(error)
        assert text and text.isprintable(), repr(text)
    finally:
        made = set(os.listdir(folder)) - before
        for name in made:
            entry = folder / name
            shutil.rmtree(entry) if entry.is_dir() else entry.unlink()
    assert not [name for name in made if ".oiiotex-" in name]


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


def seed(path: Path, kind: str, channels: int, attributes: dict) -> bytes | None:
    """A small image file of that kind; None where this OpenImageIO writes none."""
    spec = oiio.ImageSpec(23, 17, channels, kind)
    if side := attributes.get("tile"):
        spec.tile_width, spec.tile_height, spec.tile_depth = side, side, 1
    if "compression" in attributes:
        spec.attribute("compression", attributes["compression"])
    out = oiio.ImageOutput.create(str(path))
    if out is None:
        oiio.geterror()
        return None
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


READS = ("-q", "IN", "--info:verbose=1", "--stats", "-d", "float", "-o", "o.exr")
# what users hand over beside images, and the line that takes it
TAKES = {
    "graph.json": "photo.png --texsynth:graph=IN:size=16x16 -o o.exr",
    "table.json": "labels.exr photo.png --texquilt:guide=1:palette=IN:size=32x32 -o o.exr",
    "plan.npz": "photo.png --texquilt:fromplan=IN -o o.exr",
    "tile.oiiotex": shlex.join(READS),
}


def broken_file(number: int, folder: Path) -> list[str]:
    """Write the broken file of that number and say the line that reads it."""
    kinds = (*SEEDS, *TAKES)
    name = kinds[number % len(kinds)]
    if name in TAKES:
        whole, words = (folder / name).read_bytes(), shlex.split(TAKES[name])
    else:
        whole, words = seed(folder / f"seed-{name}", *SEEDS[name]), list(READS)
        if whole is None:
            return ["-q"]
    target = folder / f"in-{name}"
    target.write_bytes(broken(whole, number // len(kinds)))
    return [word.replace("IN", target.name) for word in words]


# --- many ---


class Hang(BaseException):
    """A case takes too long."""


def _stop(*_: object) -> None:
    raise Hang


def _child(kind: str, numbers: range, folder: Path) -> None:
    """Cases in this process; what fails is printed."""
    signal.signal(signal.SIGALRM, _stop)
    for number in numbers:
        (folder.parent / "number").write_text(str(number))
        faulthandler.dump_traceback_later(2 * _SECONDS, exit=True)
        words = ["?"]
        signal.alarm(_SECONDS)
        start = time.perf_counter()
        try:
            words = line(number) if kind == "lines" else broken_file(number, folder)
            do(words, folder)
        except (Exception, Hang) as error:
            at = traceback.extract_tb(error.__traceback__)[-1]
            say(number, words, f"{type(error).__name__} {error} at {at.filename}:{at.lineno}")
        finally:
            signal.alarm(0)
        if (spent := time.perf_counter() - start) > 10:
            say(number, words, f"slow, {spent:.0f} s")


def say(number: int, words: list[str], what: str) -> None:
    """A line of the report."""
    print(ascii(f"{number}: {shlex.join(words)}: {what}")[1:-1][:1500], flush=True)


def _chunks(numbers: range) -> Iterator[range]:
    for begin in range(numbers.start, numbers.stop, _CHUNK):
        yield range(begin, min(begin + _CHUNK, numbers.stop))


def main() -> None:
    """Run as many cases as are asked for, in processes that may die."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("kind", choices=("lines", "files"))
    parser.add_argument("count", type=int)
    parser.add_argument("--begin", type=int, default=0, help="the first number")
    parser.add_argument("--seconds", type=float, default=float("inf"), help="no chunk is begun after so many")
    parser.add_argument("--child", help="a folder: do it in this process")
    given = parser.parse_args()
    numbers = range(given.begin, given.begin + given.count)
    if given.child:
        _child(given.kind, numbers, Path(given.child))
        return
    begun, done = time.monotonic(), 0
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary, "cases")
        folder.mkdir()
        make_folder(folder)
        for chunk in _chunks(numbers):
            if time.monotonic() - begun > given.seconds:
                break
            first = chunk.start
            while first < chunk.stop:
                command = [sys.executable, "-m", "tests.fuzz", given.kind, str(chunk.stop - first), "--begin",
                           str(first), "--child", str(folder)]  # fmt: skip
                ended = subprocess.run(command, stderr=subprocess.PIPE, text=True, errors="replace")
                if ended.returncode == 0:
                    break
                number = int(Path(temporary, "number").read_text())
                words = line(number) if given.kind == "lines" else ["broken file"]
                say(number, words, f"the process ended with {ended.returncode}: {ended.stderr[-400:]}")
                first = number + 1
            done += len(chunk)
            print(f"{done} of {given.count} after {time.monotonic() - begun:.0f} s", flush=True)


if __name__ == "__main__":
    main()
