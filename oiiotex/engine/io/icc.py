# SPDX-License-Identifier: Apache-2.0
"""RGB encodings as files describe them: by an ICC profile (ICC.1:2022), primaries and a gamma, or CICP (ITU-T H.273).

Profiles of three curves and a matrix, or of one gray curve, are read. Others (tables, CMYK) have no such description.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from ..deferred import np

Curve = Callable[["np.ndarray"], "np.ndarray"]

D50 = (0.9642, 1.0, 0.8249)  # white of an ICC profile's connection space
D65 = (0.95047, 1.0, 1.08883)
REC709 = (0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290)  # x and y of red, green, blue and white
ADOBE = (0.64, 0.33, 0.21, 0.71, 0.15, 0.06, 0.3127, 0.3290)
_PRIMARIES = {  # by the code of H.273, table 2
    1: REC709,
    9: (0.708, 0.292, 0.170, 0.797, 0.131, 0.046, 0.3127, 0.3290),
    12: (0.68, 0.32, 0.265, 0.69, 0.15, 0.06, 0.3127, 0.3290),
}
_SRGB = (2.4, 1 / 1.055, 0.055 / 1.055, 1 / 12.92, 0.04045)  # of a parametric curve of type 3
_PARAMETERS = (1, 3, 4, 5, 7)  # numbers of a parametric curve by its type (ICC.1:2022, table 68)


@dataclass(frozen=True)
class Encoding:
    """How RGB values mean colors.

    Attributes
    ----------
    to_xyz : (3, 3) float64
        From linear RGB, as columns, to XYZ relative to D50.
    curves : three callables
        From values 0 to 1 to linear values.
    """

    to_xyz: np.ndarray
    curves: tuple[Curve, Curve, Curve]

    def xyz(self, values: np.ndarray) -> np.ndarray:
        """XYZ relative to D50, (n, 3), of values (n, 3) from 0 to 1."""
        linear = np.stack([curve(values[:, n]) for n, curve in enumerate(self.curves)], -1)
        return linear @ self.to_xyz.T


def of_profile(profile: bytes) -> Encoding | None:
    """The encoding of an ICC profile; None if it is damaged or of another kind."""
    try:
        tags = _tags(profile)
        if profile[16:20] == b"GRAY":
            return _of(REC709, _curve(tags[b"kTRC"]))  # any primaries give the same gray
        columns = [struct.unpack(">3i", tags[name][8:20]) for name in (b"rXYZ", b"gXYZ", b"bXYZ")]
        red, green, blue = (_curve(tags[name]) for name in (b"rTRC", b"gTRC", b"bTRC"))
    except (KeyError, ValueError, IndexError, struct.error):
        return None
    return Encoding(np.array(columns, np.float64).T / 65536, (red, green, blue))


def of_primaries(chromaticities: Sequence[float], gamma: float) -> Encoding | None:
    """The encoding of primaries (x and y of red, green, blue and white) and a gamma; None if they span no space."""
    return _of(chromaticities, lambda values: np.power(values, gamma))


def of_cicp(codes: Sequence[int]) -> Encoding | None:
    """The encoding of CICP codes (primaries, transfer, ...); None for those without a known curve."""
    curves: dict[int, Curve] = {
        1: _bt709, 4: lambda values: np.power(values, 2.2), 8: lambda values: values, 13: _parametric(3, _SRGB),
    }  # fmt: skip
    primaries, curve = _PRIMARIES.get(codes[0]), curves.get(codes[1])
    return None if primaries is None or curve is None else _of(primaries, curve)


def adapted(xyz: np.ndarray, white: Sequence[float], other: Sequence[float]) -> np.ndarray:
    """XYZ (..., 3) adapted from one white to another (Bradford, ICC.1:2022 annex E)."""
    cone = np.array([[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]])
    ratio = (cone @ np.asarray(other)) / (cone @ np.asarray(white))
    change = np.linalg.inv(cone) @ np.diag(ratio) @ cone
    return np.asarray(xyz) @ change.T


def lab_of_xyz(xyz: np.ndarray) -> np.ndarray:
    """CIE Lab of XYZ relative to white, (..., 3) (CIE 15:2018, 8.2.1)."""
    f = np.where(xyz > (6 / 29) ** 3, np.cbrt(xyz), xyz / (3 * (6 / 29) ** 2) + 4 / 29)
    return np.stack([116 * f[..., 1] - 16, 500 * (f[..., 0] - f[..., 1]), 200 * (f[..., 1] - f[..., 2])], -1)


def _of(chromaticities: Sequence[float], curve: Curve) -> Encoding | None:
    x, y = np.array(chromaticities, np.float64).reshape(4, 2).T
    if not (y > 0)[3] or not np.isfinite([x, y]).all():
        return None
    points = np.stack([x, y, 1 - x - y])
    white = points[:, 3] / y[3]
    try:
        matrix = points[:, :3] * np.linalg.solve(points[:, :3], white)
    except np.linalg.LinAlgError:
        return None
    return Encoding(adapted(matrix.T, white, D50).T, (curve, curve, curve))


def _tags(profile: bytes) -> dict[bytes, bytes]:
    (count,) = struct.unpack(">I", profile[128:132])
    rows = [struct.unpack(">4sII", profile[132 + 12 * n : 144 + 12 * n]) for n in range(min(count, 200))]
    return {name: profile[start : start + size] for name, start, size in rows}


def _curve(tag: bytes) -> Curve:
    """A curve of type curv or para (ICC.1:2022, 10.6 and 10.18)."""
    if tag[:4] == b"para":
        (kind,) = struct.unpack(">H", tag[8:10])
        count = _PARAMETERS[kind]
        return _parametric(kind, [n / 65536 for n in struct.unpack(f">{count}i", tag[12 : 12 + 4 * count])])
    if tag[:4] != b"curv":
        raise ValueError
    (count,) = struct.unpack(">I", tag[8:12])
    samples = struct.unpack(f">{count}H", tag[12 : 12 + 2 * count])
    if count < 2:
        gamma = samples[0] / 256 if samples else 1.0
        return lambda values: np.power(values, gamma)
    return lambda values: np.interp(values, np.linspace(0, 1, count), np.array(samples) / 65535)


def _parametric(kind: int, numbers: Sequence[float]) -> Curve:
    """ICC.1:2022, table 68: (a x + b)^g + e from d on, else c x + f."""
    g, a, b, c, d, e, f = (*numbers, *(0.0,) * (7 - len(numbers)))
    if kind == 0:
        return lambda values: np.power(values, g)
    if kind in (1, 2):
        d, e, f, c = (-b / a if a else 0.0), (c if kind == 2 else 0.0), (c if kind == 2 else 0.0), 0.0

    def curve(values: np.ndarray) -> np.ndarray:
        powered = np.power(np.maximum(a * values + b, 0), g) + e
        return np.where(values >= d, powered, c * values + f)

    return curve


def _bt709(values: np.ndarray) -> np.ndarray:
    """The inverse of the transfer function of ITU-R BT.709."""
    return np.where(values < 0.081, values / 4.5, np.power((values + 0.099) / 1.099, 1 / 0.45))
