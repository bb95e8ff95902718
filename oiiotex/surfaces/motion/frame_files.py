# SPDX-License-Identifier: Apache-2.0
"""The files of a shot, named by one of them and a range of frames."""

from __future__ import annotations

import os
import re

from ...engine.color.config import as_float
from ...engine.core.image import Image, Part, channels_of, cropped
from ...engine.core.window import Window
from ...engine.deferred import np
from ...engine.errors import ImageError, ParameterError
from ...engine.io.reading import read

_MOST = 10_000
_DIGITS = 10  # from here on it is a date and time, not a frame number
_ROWS = 64  # of a band of a mask
_LEAST = 0.01  # smaller values of a mask count as 0: JPEG files are never quite black


def numbered(name: str) -> int | None:
    """The frame number in a file name: the last digits before its suffix; None if there are none or too many."""
    found = re.search(r"([0-9]+)\D*\Z", os.path.splitext(os.path.basename(name))[0])
    return int(found[1]) if found and len(found[1].lstrip("0")) < _DIGITS else None


def frame_range(text: str, number: int | None) -> list[int]:
    """The frames of FIRST-LAST, which must include the reference frame.

    Raises
    ------
    ParameterError
    """
    found = re.fullmatch(r"([0-9]{1,9})-([0-9]{1,9})", text)
    if not found or not 0 <= int(found[2]) - int(found[1]) < _MOST:
        raise ParameterError(parameter="frames", value=text, expected=f"FIRST-LAST, at most {_MOST} frames")
    frames = list(range(int(found[1]), int(found[2]) + 1))
    if number not in frames:
        which = "has no frame number in its name" if number is None else f"is frame {number}"
        raise ParameterError(parameter="frames", value=text, expected=f"a range that includes the image, which {which}")
    return frames


def files(image: Image, frames: list[int], number: int, name: str, still: bool = False) -> dict[int, str]:
    """The file of every frame, from the file of frame `number`.

    Parameters
    ----------
    image : Image
        An image identical to its file, apart from metadata.
    name : str
        For messages.
    still : bool
        Whether one file may serve all frames.

    Raises
    ------
    ImageError
        The image differs from its file, its name has no number, or files are missing.
    """
    named = siblings(image.source, frames, number, name, still)
    own = read(named[number]).first if os.path.isfile(named[number]) else None
    same = own is not None and (own.window, own.spec.nchannels) == (image.first.window, image.first.spec.nchannels)
    if own is None or not same or not np.array_equal(own.pixels(), image.first.pixels(), equal_nan=True):
        raise ImageError(
            f"{name} {image.source} differs from its file: the other frames are read from files, without these changes",
            hint="write the changed frames first",
        )
    return named


def siblings(path: str, frames: list[int], number: int, name: str, still: bool = False) -> dict[int, str]:
    """As `files`, from a file name."""
    if numbered(path) != number:
        if still:
            return dict.fromkeys(frames, path)
        raise ImageError(f"{name} {path}: expected {number} in the file name, the number of the reference frame")
    folder, base = os.path.split(path)
    stem, suffix = os.path.splitext(base)
    before, digits, after = re.fullmatch(r"(.*?)([0-9]+)(\D*)", stem).groups()  # type: ignore[union-attr]
    named = {n: os.path.join(folder, f"{before}{n:0{len(digits)}}{after}{suffix}") for n in frames}
    missing = [n for n, file in named.items() if not os.path.isfile(file)]
    if missing:
        more = f" (and {len(missing) - 1} more)" if len(missing) > 1 else ""
        raise ImageError(f"{name}: frame {missing[0]} is missing: no file {named[missing[0]]}{more}")
    return named


def values_of(part: Part, display: Window, name: str) -> np.ndarray:
    """The pixels of the display window, (height, width, c) float32, black outside the data window.

    Raises
    ------
    ImageError
        The part has another display window.
    """
    return as_float(_shown(part, display, name).pixels())


def region_of(part: Part, display: Window, name: str) -> np.ndarray:
    """A mask as (height, width) float32, 0 to 1; raises as `values_of` does."""
    return _coverage(values_of(part, display, name), part)


def covered(part: Part, display: Window, name: str) -> np.ndarray:
    """Where a mask is not black, (height, width) bool, read in bands of rows; raises as `values_of` does."""
    shown = _shown(part, display, name)
    bands = shown.window.cells(display.width, _ROWS)
    return np.concatenate([_coverage(as_float(shown.read(band)), part) > 0 for band in bands])


def _shown(part: Part, display: Window, name: str) -> Part:
    own = Window.display(part.spec)
    if own.size != display.size:
        sizes = f"{own.width}x{own.height}, but the frame is {display.width}x{display.height}"
        raise ImageError(f"{name} is {sizes}: expected the same size")
    return cropped(part, own)


def _coverage(values: np.ndarray, part: Part) -> np.ndarray:
    coverage = values[..., channels_of(part.spec).first]
    return np.where(coverage > _LEAST, np.minimum(coverage, 1), 0)
