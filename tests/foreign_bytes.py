# SPDX-License-Identifier: Apache-2.0
"""Files as their specifications describe them, byte by byte: formats that no other library of the tests writes."""

from __future__ import annotations

import gzip
import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np

WIDTH, HEIGHT = 23, 14


def ramp(channels: int = 3) -> np.ndarray:
    """Different in all four corners: a flipped row order shows."""
    y, x = np.indices((HEIGHT, WIDTH))
    planes = [x * 5 + y * 7, y * 16, (x * y) % 250, 250 - x * 3]
    return np.stack(planes[:channels], -1).astype(np.uint8)


FLOATS = (ramp() / 255).astype(np.float32)


def exr(names: str = "RGBZ", *, downwards: bool = False) -> bytes:
    """OpenEXR file layout: an uncompressed scanline image of halves, whose Z is float."""

    def attribute(name: str, kind: str, value: bytes) -> bytes:
        return f"{name}\0{kind}\0".encode() + struct.pack("<i", len(value)) + value

    planes = dict(zip("RGBZ", np.moveaxis(np.concatenate([FLOATS, FLOATS[..., :1] * 1e6], -1), -1, 0), strict=True))
    kinds = {name: (2, "<f4") if name == "Z" else (1, "<f2") for name in sorted(names)}
    channels = b"".join(f"{name}\0".encode() + struct.pack("<iiii", kinds[name][0], 0, 1, 1) for name in kinds)
    window = struct.pack("<iiii", 5, -3, 5 + WIDTH - 1, -3 + HEIGHT - 1)
    head = b"\x76\x2f\x31\x01" + struct.pack("<i", 2) + b"".join([
        attribute("channels", "chlist", channels + b"\0"), attribute("compression", "compression", b"\0"),
        attribute("dataWindow", "box2i", window), attribute("displayWindow", "box2i", window),
        attribute("lineOrder", "lineOrder", bytes([downwards])),
        attribute("pixelAspectRatio", "float", struct.pack("<f", 1)),
        attribute("screenWindowCenter", "v2f", bytes(8)), attribute("screenWindowWidth", "float", struct.pack("<f", 1)),
    ]) + b"\0"  # fmt: skip
    rows = []
    for y in range(HEIGHT):
        row = b"".join(planes[name][y].astype(kinds[name][1]).tobytes() for name in kinds)
        rows.append(struct.pack("<ii", y - 3, len(row)) + row)
    order = range(HEIGHT - 1, -1, -1) if downwards else range(HEIGHT)
    places, at = [0] * HEIGHT, len(head) + 8 * HEIGHT
    for y in order:
        places[y], at = at, at + len(rows[y])
    return head + struct.pack(f"<{HEIGHT}Q", *places) + b"".join(rows[y] for y in order)


def _ten_bits(bytes_first: str) -> bytes:
    """Three components of 10 bits in a word of 32, filled from the top; two bits of padding (method A)."""
    r, g, b = np.moveaxis(ramp().astype(np.uint32) * 4, -1, 0)
    return (r << 22 | g << 12 | b << 2).astype(f"{bytes_first}u4").tobytes()


def dpx(order: str = ">") -> bytes:
    """SMPTE 268M: one element of RGB, 10 bits, packing by method A."""
    head = bytearray(b"\xff" * 2048)

    def put(at: int, kind: str, *values: object) -> None:
        struct.pack_into(order + kind, head, at, *values)

    put(0, "4sI8sI", b"SDPX" if order == ">" else b"XPDS", 2048, b"V1.0".ljust(8, b"\0"), 2048 + 4 * WIDTH * HEIGHT)
    put(20, "IIII", 1, 1664, 384, 0)
    head[36:660] = bytes(624)  # names and dates
    put(768, "HHII", 0, 1, WIDTH, HEIGHT)
    put(780, "IIfIfBBBBHHIII", 0, 0, 0.0, 1023, 2.0, 50, 2, 2, 10, 1, 0, 2048, 0, 0)
    head[820:852] = bytes(32)
    put(1628, "II", 1, 1)  # pixel aspect
    return bytes(head) + _ten_bits(order)


def cineon() -> bytes:
    """Kodak Cineon 4.5: three channels of 10 bits, pixel interleave, 32-bit words packed from the left."""
    head = bytearray(2048)
    struct.pack_into(">6I8s", head, 0, 0x802A5FD7, 2048, 1024, 1024, 0, 2048 + 4 * WIDTH * HEIGHT, b"V4.5")
    struct.pack_into(">BB", head, 192, 0, 3)
    for channel in range(3):
        at = 196 + 28 * channel
        struct.pack_into(">BBBBIIffff", head, at, 0, channel + 1, 10, 0, WIDTH, HEIGHT, 0, 0, 1023, 2.046)
    struct.pack_into(">BBBBII", head, 680, 0, 5, 0, 0, 0, 0)
    return bytes(head) + _ten_bits(">")


def iff() -> bytes:
    """Maya IFF: tiles of BGR in 8 bits without compression; rows, and tiles, from the bottom."""

    def chunk(name: bytes, data: bytes) -> bytes:
        return name + struct.pack(">I", len(data)) + data + bytes(-len(data) % 4)

    upwards, tiles = ramp()[::-1], []
    for top in range(0, HEIGHT, 8):
        for left in range(0, WIDTH, 8):
            tile = upwards[top : top + 8, left : left + 8]
            corner = struct.pack(">4H", left, top, left + tile.shape[1] - 1, top + tile.shape[0] - 1)
            tiles.append(chunk(b"RGBA", corner + tile[..., ::-1].tobytes()))
    head = struct.pack(">IIHHIHHIii", WIDTH, HEIGHT, 1, 1, 1, 0, len(tiles), 0, 0, 0)
    return chunk(b"FOR4", b"CIMG" + chunk(b"TBHD", head) + chunk(b"FOR4", b"TBMP" + b"".join(tiles)))


def psd(layers: dict[bytes, tuple[int, int, int, int]] | None = None) -> bytes:
    """Adobe Photoshop file format: RGB in 8 bits, planar, PackBits; layers by name, as (top, left, bottom, right)."""

    def packed(row: np.ndarray) -> bytes:
        return bytes([len(row) - 1]) + row.tobytes()  # one literal run

    def sized(data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + data

    records, planes = b"", b""
    for name, (top, left, bottom, right) in (layers or {}).items():
        height, width = bottom - top, right - left
        area = 2 + height * width
        records += struct.pack(">4iH", top, left, bottom, right, 3)
        records += b"".join(struct.pack(">HI", channel, area) for channel in range(3))
        pascal = bytes([len(name)]) + name
        extra = sized(b"") + sized(b"") + pascal + bytes(-len(pascal) % 4)
        records += b"8BIMnorm" + struct.pack(">BBBB", 255, 0, 0, 0) + sized(extra)
        shades = (np.indices((height, width)).sum(0) * 9 % 251).astype(np.uint8)
        planes += b"".join(b"\0\0" + (shades + channel).tobytes() for channel in range(3))
    info = struct.pack(">h", len(layers or {})) + records + planes if layers else b""
    info += bytes(-len(info) % 2)
    rows = [packed(row) for plane in np.moveaxis(ramp(), -1, 0) for row in plane]
    lengths = struct.pack(f">{len(rows)}H", *map(len, rows))
    head = b"8BPS" + struct.pack(">H6xHIIHH", 1, 3, HEIGHT, WIDTH, 8, 3)
    sections = sized(b"") + sized(b"") + (sized(sized(info) + sized(b"")) if layers else sized(b""))
    return head + sections + b"\0\1" + lengths + b"".join(rows)


def rla() -> bytes:
    """Wavefront RLA: run-length records of planes, rows from the bottom."""
    head = bytearray(740)
    struct.pack_into(">14h", head, 0, 0, WIDTH - 1, 0, HEIGHT - 1, 0, WIDTH - 1, 0, HEIGHT - 1, 1, 0, 3, 0, 0, -2)
    struct.pack_into(">16s", head, 28, b"1.0")
    struct.pack_into(">hhhhh", head, 658, 8, 0, 8, 0, 8)
    head[702:740] = bytes(38)
    rows = []
    for row in ramp()[::-1]:
        data = bytes([256 - WIDTH])  # a run of literals
        rows.append(b"".join(struct.pack(">H", 1 + WIDTH) + data + row[:, c].tobytes() for c in range(3)))
    places = np.cumsum([740 + 4 * HEIGHT] + [len(row) for row in rows[:-1]])
    return bytes(head) + struct.pack(f">{HEIGHT}i", *places) + b"".join(rows)


def softimage() -> bytes:
    """Softimage PIC: RGB and alpha in two packets, the first in mixed runs, the second in pure runs."""
    head = struct.pack(">If80s4sHHfHH", 0x5380F634, 3.5, b"", b"PICT", WIDTH, HEIGHT, 1.0, 3, 0)
    packets = bytes([1, 8, 2, 0xE0, 0, 8, 1, 0x10])
    data = b""
    for row in ramp(4):
        data += bytes([WIDTH - 1]) + row[:, :3].tobytes()
        data += b"".join(bytes([1, value]) for value in row[:, 3])
    return head + packets + data


def zfile() -> bytes:
    """Pixar Zfile: magic, size, two matrices, and depths, all in gzip."""
    matrix = np.eye(4, dtype="<f4").tobytes()
    depths = (ramp(1)[..., 0] / 16 + 1).astype("<f4").tobytes()
    return gzip.compress(struct.pack("<Ihh", 0x2F0867AB, WIDTH, HEIGHT) + matrix + matrix + depths, mtime=0)


def jxl() -> bytes:
    """ISO/IEC 18181-1: one modular group without prediction, and a flat prefix code of 512 symbols."""
    bits: list[int] = []

    def put(count: int, value: int = 0) -> None:
        bits.extend(value >> n & 1 for n in range(count))

    def aligned() -> None:
        put(-len(bits) % 8)

    put(16, 0x0AFF)
    put(1)  # SizeHeader: not a multiple of 8
    put(2), put(9, HEIGHT - 1), put(3), put(2), put(9, WIDTH - 1)
    put(2), put(1), put(2), put(1, 1), put(2)  # ImageMetadata: 8 bits, buffers of 16, no extra channels
    put(1), put(1, 1), put(2), put(1, 1)  # not XYB, sRGB, no extensions, default transform
    aligned()
    put(1), put(2), put(1, 1), put(2), put(1)  # FrameHeader: regular, modular, no flags, not YCbCr
    put(2), put(2, 1), put(2), put(1), put(2), put(1, 1), put(2)  # sizes, one pass, no crop, replace, last, no name
    put(1), put(1), put(2), put(2), put(2)  # no restoration filter, no extensions
    head, bits[:] = bits[:], []
    put(1, 1), put(1), put(1), put(1, 1), put(2)  # LfGlobal: default dequantization, a tree of this group alone
    put(1), put(1, 1), put(2), put(1, 1), put(4, 15), put(1)  # the tree, one leaf: all its symbols are 0
    put(1), put(1, 1), put(4, 15)  # pixels: no LZ77, a prefix code, tokens are values
    put(1, 1), put(4, 8), put(8, 255)  # 512 symbols
    put(2), put(22), put(2, 2), put(12)  # lengths of codes: only that of 9 bits
    for value in np.moveaxis(ramp(), -1, 0).ravel():
        put(9, int(f"{2 * int(value):09b}"[::-1], 2))  # packed sign: even is positive
    aligned()
    section, bits[:] = bits[:], head
    put(1)  # TOC: not permuted
    aligned()
    put(2, 1), put(14, len(section) // 8 - 1024)
    aligned()
    return np.packbits(np.array(bits + section, np.uint8), bitorder="little").tobytes()


def written(data: bytes) -> Callable[[Path], object]:
    """What writes these bytes to a path."""
    return lambda path: path.write_bytes(data)


BY_SPECIFICATION = {
    "half.exr": written(exr("RGB")), "mixed.exr": written(exr()), "downwards.exr": written(exr(downwards=True)),
    "be.dpx": written(dpx(">")), "le.dpx": written(dpx("<")), "rgb.cin": written(cineon()), "tiles.iff": written(iff()),
    "flat.psd": written(psd()), "rgb.rla": written(rla()), "rgba.pic": written(softimage()),
    "depth.zfile": written(zfile()), "lossless.jxl": written(jxl()),
}  # fmt: skip
