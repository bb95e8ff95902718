# SPDX-License-Identifier: Apache-2.0
"""The same chain through the wheel's own oiiotool and through oiiotex: pixels, type, windows, channels, metadata."""

from __future__ import annotations

import contextlib
import shlex
import subprocess
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest

from oiiotex.engine.errors import Error
from oiiotex.oiiotool.cli.running.line_run import run

OIIOTOOL = Path(oiio.__file__).parent / "bin" / "oiiotool"  # the script of this name starts a Python first
_ATTRIBUTES = "limits:channels", "jpeg:com_attributes", "png:linear_premult", "try_all_readers"
# what names the program that wrote a file, and when
_OWN = ("Software", "DateTime", "Exif:ImageHistory", "capDate")


@contextlib.contextmanager
def process_as_before() -> Iterator[None]:
    """Lines set attributes of OpenImageIO for their process, here that of the tests."""
    kind = oiio.TypeDesc("int")
    values = {name: oiio.getattribute(name, kind) for name in _ATTRIBUTES}
    try:
        yield
    finally:
        for name, value in values.items():
            oiio.attribute(name, kind, value)


def same(folder: Path, *words: object, tolerance: float = 0.0) -> None:
    """Run a chain that writes 'OUT.<ext>' through both programs in `folder` and compare what they write.

    `tolerance` is the largest difference of a pixel value that is let pass; nothing else is.
    """
    texts = [str(word) for word in words]
    theirs = [text.replace("OUT.", "theirs.") for text in texts]
    ours = [text.replace("OUT.", "ours.") for text in texts]
    done = subprocess.run([OIIOTOOL, *theirs], cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr + done.stdout
    with process_as_before():
        status = run(ours, folder)
    assert status == 0, status
    for text in texts:
        if "OUT." in text:
            name = text[text.index("OUT.") :]
            files = folder / name.replace("OUT.", "ours."), folder / name.replace("OUT.", "theirs.")
            assert_same_file(*files, tolerance)
            assert_same_thumbnail(*files)


def chains(table: str) -> list[str]:
    """The chains of a table: in each line images (- for none), then between bars what is done to them.

    A chain that names no file writes OUT, of the first image's format.
    """
    found = []
    for images, *works in (line.split(" | ") for line in table.splitlines() if line):
        before, ending = ("", ".exr") if images == "-" else (f"{images} ", Path(images.split()[0]).suffix)
        found += [before + work + ("" if "OUT." in work else f" -o OUT{ending}") for work in works]
    return found


def refused(folder: Path, chain: str, says: str) -> str:
    """Run a chain that would write 'o.exr' in `folder`: it fails in one line that says so, and leaves nothing."""
    with pytest.raises(Error) as caught:
        run(shlex.split(chain), folder)
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)
    assert not (folder / "o.exr").exists()
    return str(caught.value)


def assert_same_file(ours: Path, theirs: Path, tolerance: float = 0.0) -> None:
    """Compare two image files in everything that matters."""
    a, b = oiio.ImageInput.open(str(ours)), oiio.ImageInput.open(str(theirs))
    assert a is not None and b is not None, oiio.geterror()
    subimage = 0
    while True:
        there = a.seek_subimage(subimage, 0), b.seek_subimage(subimage, 0)
        assert there[0] == there[1], f"part {subimage}: {there}"
        if not there[0]:
            return
        level = 0
        while True:
            there = a.seek_subimage(subimage, level), b.seek_subimage(subimage, level)
            assert there[0] == there[1], f"part {subimage} level {level}: {there}"
            if not there[0]:
                break
            assert facts(a.spec()) == facts(b.spec())
            if b.spec().deep:
                assert_same_samples(*(i.read_native_deep_image(subimage, level) for i in (a, b)))
                level += 1
                continue
            x, y = (i.read_image(subimage, level, 0, i.spec().nchannels, i.spec().format) for i in (a, b))
            if tolerance:
                np.testing.assert_allclose(x.astype(np.float64), y.astype(np.float64), rtol=0, atol=tolerance)
            else:
                np.testing.assert_array_equal(x, y)
            level += 1
        subimage += 1


def assert_same_samples(a: oiio.DeepData, b: oiio.DeepData) -> None:
    """Compare the samples of two deep images, of which neither has none."""

    def samples(data: oiio.DeepData) -> list[list[float]]:
        return [
            [data.deep_value(pixel, channel, n) for n in range(data.samples(pixel)) for channel in range(data.channels)]
            for pixel in range(data.pixels)
        ]

    assert samples(a) == samples(b)
    assert any(samples(b))


def assert_same_thumbnail(ours: Path, theirs: Path) -> None:
    """Compare the thumbnails of two image files; neither may have one."""
    a, b = (oiio.ImageInput.open(str(path)).get_thumbnail(0) for path in (ours, theirs))
    assert a.initialized == b.initialized
    if b.initialized:
        np.testing.assert_array_equal(a.get_pixels(), b.get_pixels())


def facts(spec: oiio.ImageSpec) -> dict[str, object]:
    """What a spec says, less what names the program that wrote it."""
    found: dict[str, object] = {
        name: getattr(spec, name)
        for name in ("x", "y", "width", "height", "full_x", "full_y", "full_width", "full_height", "nchannels", "deep",
                     "channelnames", "alpha_channel", "z_channel", "tile_width", "tile_height")
    }  # fmt: skip
    found["type"] = [str(spec.channelformat(c)) for c in range(spec.nchannels)]
    for attribute in spec.extra_attribs:
        if attribute.name not in _OWN and not attribute.name.startswith("oiiotex:"):
            value = attribute.value
            found[attribute.name] = value.tolist() if isinstance(value, np.ndarray) else value
    return found
