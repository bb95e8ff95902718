# SPDX-License-Identifier: Apache-2.0
"""What the tests share: devices, pictures on disk, the installed program."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest

from oiiotex import device as devices
from tests import pictures


class NarrowDevice(devices.Device):
    """The CPU seen as a GPU is: every work-item a single lane."""

    lanes = 1


@pytest.fixture(scope="session")
def device() -> devices.Device:
    return devices.open_device()


@pytest.fixture(scope="session")
def narrow_device() -> devices.Device:
    return NarrowDevice(devices.choose())


@pytest.fixture(params=["wide", "narrow"])
def any_lanes(request: pytest.FixtureRequest) -> devices.Device:
    """The device with its own lanes, and with one."""
    return request.getfixturevalue("device" if request.param == "wide" else "narrow_device")


@pytest.fixture
def photo(tmp_path: Path) -> Path:
    """A 96 x 80 sRGB PNG of stained bricks."""
    path = tmp_path / "photo.png"
    save(pictures.stained(pictures.bricks(80, 96, seed=1)), path)
    return path


def save(pixels: np.ndarray, path: Path, kind: str = "uint8", space: str = "", **windows: int) -> Path:
    """Write (h, w, c) floats in 0 .. 1 (or beyond, for float types) as an image; `windows` are ImageSpec fields."""
    spec = oiio.ImageSpec(pixels.shape[1], pixels.shape[0], pixels.shape[2], oiio.FLOAT)
    for name, value in windows.items():
        setattr(spec, name, value)
    if space:
        spec.attribute("oiio:ColorSpace", space)
    buffer = oiio.ImageBuf(spec)
    buffer.set_pixels(buffer.roi, np.ascontiguousarray(pixels, np.float32))
    assert buffer.write(str(path), kind), buffer.geterror()
    return path


def load(path: Path, subimage: int = 0) -> np.ndarray:
    """All pixels of a file in their own type."""
    buffer = oiio.ImageBuf(str(path), subimage, 0)
    assert not buffer.has_error, buffer.geterror()
    return buffer.get_pixels(buffer.spec().format, buffer.roi)


def oiiotex(*words: object, **options: object) -> subprocess.CompletedProcess:
    """Run the installed program."""
    command = [sys.executable, "-m", "oiiotex.cli.main", *map(str, words)]
    return subprocess.run(command, capture_output=True, text=True, timeout=300, **options)


@pytest.fixture
def fails(tmp_path: Path) -> Callable[..., str]:
    """Run the program, expect exit 1, one line on stderr and an untouched old output; returns the line."""

    def run(*words: object) -> str:
        old = tmp_path / "old.png"
        old.write_bytes(b"the user's own")
        done = oiiotex(*words, "-o", old, cwd=tmp_path)
        lines = done.stderr.strip().splitlines()
        assert (done.returncode, len(lines)) == (1, 1), done
        assert lines[0].startswith("oiiotex ERROR: ")
        assert old.read_bytes() == b"the user's own"
        assert not list(tmp_path.glob(".*oiiotex*"))
        return lines[0]

    return run


def data_folder() -> Path:
    """The real photos; tests skip where they are absent."""
    folder = Path(os.environ.get("OIIOTEX_TEST_DATA", Path(__file__).parents[2] / "shared" / "data"))
    if not folder.is_dir():
        pytest.skip("no test photos: set OIIOTEX_TEST_DATA")
    return folder
