# SPDX-License-Identifier: Apache-2.0
"""Palettes of paint programs, .gpl (GIMP, Krita, Inkscape) and .aco (Photoshop), and PNGs with a palette."""

from __future__ import annotations

import json
import struct
import zlib
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from ..deferred import np
from ..errors import ImageError, one_line
from .atomic import temporary_beside, written

_SIGNATURE = b"\x89PNG\r\n\x1a\n"


class Swatch(NamedTuple):
    """A named color, sRGB in 8 bits."""

    name: str
    red: int
    green: int
    blue: int


def require_palette(path: Path) -> None:
    """Refuse, with ImageError, a file name with another suffix."""
    _writer(path)


def write_palette(path: Path, paints: Sequence[Swatch]) -> None:
    """Write a palette atomically.

    Raises
    ------
    ImageError
        The suffix is not .gpl or .aco, or the file cannot be written.
    """
    text = _writer(path)(path.stem, paints)
    with temporary_beside(path) as temporary:
        temporary.write_bytes(text)


def write_indexed(path: Path, ids: np.ndarray, colors: Mapping[int, Sequence[int]], facts: Mapping[str, Any]) -> None:
    """Write ids, (height, width) uint8, as a PNG with a palette of their colors; OpenImageIO cannot write palettes.

    Parameters
    ----------
    path : Path
    ids : (height, width) uint8
    colors : dict of int to (int, int, int)
        Color of each id; other ids are black.
    facts : mapping
        Values by name, written as JSON in text chunks.

    Raises
    ------
    ImageError
        The file cannot be written.
    """
    height, width = ids.shape
    palette = bytes(channel for index in range(256) for channel in colors.get(index, (0, 0, 0)))
    rows = np.zeros((height, width + 1), np.uint8)  # each row begins with its filter type, 0 (none)
    rows[:, 1:] = ids
    chunks = (
        (b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 3, 0, 0, 0)),
        (b"PLTE", palette),
        *((b"tEXt", f"{name}\0{json.dumps(value)}".encode()) for name, value in facts.items()),
        (b"IDAT", zlib.compress(rows.tobytes(), 3)),
        (b"IEND", b""),
    )
    with written(path) as file:
        file.write(_SIGNATURE)
        for name, data in chunks:
            file.write(struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data)))


def _writer(path: Path) -> Callable[[str, Sequence[Swatch]], bytes]:
    writers = {".gpl": _gimp, ".aco": _photoshop}
    if path.suffix.lower() not in writers:
        raise ImageError(f"{path}: unknown palette", expected=".gpl (GIMP, Krita, Inkscape) or .aco (Photoshop)")
    return writers[path.suffix.lower()]


def _gimp(title: str, paints: Sequence[Swatch]) -> bytes:
    lines = ["GIMP Palette", f"Name: {one_line(title)}", "Columns: 0", "#"]
    lines += [f"{p.red:3} {p.green:3} {p.blue:3}\t{one_line(p.name)}" for p in paints]
    return ("\n".join(lines) + "\n").encode()


def _photoshop(_: str, paints: Sequence[Swatch]) -> bytes:
    """Versions 1 and 2, one after the other: version 2 adds names, as UTF-16 with their length."""
    plain, named = b"", b""
    for paint in paints:
        color = struct.pack(">5H", 0, *(257 * n for n in paint[1:]), 0)
        name = f"{one_line(paint.name)}\0".encode("utf-16-be")
        plain += color
        named += color + struct.pack(">I", len(name) // 2) + name
    count = len(paints)
    return struct.pack(">2H", 1, count) + plain + struct.pack(">2H", 2, count) + named
