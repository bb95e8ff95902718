# SPDX-License-Identifier: Apache-2.0
"""sRGB, linear Rec. 709 and CIE Lab D65 by their formulas, independent of the user's OCIO config: for display only."""

from __future__ import annotations

from ..deferred import np
from ..io.icc import D65, lab_of_xyz

LUMA = (0.2126, 0.7152, 0.0722)  # luminance of linear Rec. 709


def encoded(linear: np.ndarray) -> np.ndarray:
    """Linear Rec. 709 as sRGB, clipped to 0 to 1."""
    linear = np.clip(linear, 0, 1)
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)


def decoded(srgb: np.ndarray | np.float32) -> np.ndarray:
    """The inverse of `encoded`."""
    return np.where(srgb <= 0.04045, srgb / 12.92, ((np.maximum(srgb, 0) + 0.055) / 1.055) ** 2.4)


def lab_of_linear(linear: np.ndarray) -> np.ndarray:
    """Convert linear Rec. 709 to CIE Lab D65, (..., 3)."""
    xyz = linear @ np.array([[0.4124564, 0.2126729, 0.0193339],
                             [0.3575761, 0.7151522, 0.1191920],
                             [0.1804375, 0.0721750, 0.9503041]])  # fmt: skip
    return lab_of_xyz(xyz / D65)


def srgb_of_lab(lab: np.ndarray) -> np.ndarray:
    """Convert CIE Lab D65 to sRGB, clipped to 0 to 1, (..., 3)."""
    f = (lab[..., :1] + 16) / 116 + np.stack([lab[..., 1] / 500, np.zeros_like(lab[..., 1]), -lab[..., 2] / 200], -1)
    xyz = np.where(f > 6 / 29, f**3, (f - 4 / 29) * 3 * (6 / 29) ** 2) * D65
    return encoded(xyz @ np.array([[3.2404542, -0.9692660, 0.0556434],
                                   [-1.5371385, 1.8760108, -0.2040259],
                                   [-0.4985314, 0.0415560, 1.0572252]]))  # fmt: skip
