# SPDX-License-Identifier: Apache-2.0
"""Descriptions of a file's colors other than the name of a space: a profile, primaries, CICP codes, Exif.

OpenImageIO's readers tag most 8-bit files as sRGB, even if they say otherwise. `color.described`
finds the space of a config with these colors.
"""

from __future__ import annotations

import functools
import re
from dataclasses import dataclass

from ..core.attributes import TAG
from ..core.image import Image
from ..deferred import np, oiio
from ..errors import present
from .icc import D50, D65, Encoding, adapted, lab_of_xyz, of_cicp, of_primaries, of_profile

_ALIKE = 0.5  # largest difference in Lab of two descriptions of the same space: rounding of their numbers
_SRGB = (1, 13)  # CICP
UNCALIBRATED = 65535  # Exif:ColorSpace
_NOT_SRGB = (2, UNCALIBRATED)  # 2: Adobe RGB by convention


@dataclass(frozen=True)
class Evidence:
    """A description of colors: its kind and name for messages, and its encoding if that is known."""

    text: str
    name: str = ""
    encoding: Encoding | None = None


def evidence_in(spec: oiio.ImageSpec) -> Evidence | None:
    """The description in the metadata, by the precedence of PNG (third edition, 4.3); None: nothing."""
    cicp, profile = spec.getattribute("CICP"), spec.getattribute("ICCProfile")
    if cicp is not None:
        codes = tuple(int(code) for code in cicp)
        return Evidence(f"CICP {'/'.join(map(str, codes))}", encoding=of_cicp(codes))
    if profile is not None:
        name = spec.get_string_attribute("ICCProfile:profile_description").strip("\0 ")
        text = f"the ICC profile '{name}'" if name else "an ICC profile without a name"
        return Evidence(text, name, of_profile(bytes(bytearray(int(n) for n in profile))))
    primaries = spec.getattribute("chromaticities")
    if primaries is not None and len(primaries) == 8:
        gamma = spec.get_float_attribute("oiio:Gamma", 1.0)
        values = ", ".join(f"{value:.4g}" for value in primaries)
        return Evidence(f"chromaticities {values} and gamma {gamma:.3g}", encoding=of_primaries(primaries, gamma))
    if spec.get_int_attribute("Exif:ColorSpace") in _NOT_SRGB:
        return Evidence("uncalibrated colors by Exif")
    return None


def contradicted(spec: oiio.ImageSpec) -> bool:
    """Whether the metadata contradicts the tag sRGB."""
    evidence = evidence_in(spec)
    if evidence is None:
        return False
    if evidence.encoding is None:
        return "srgb" not in plain(evidence.name)
    srgb = present(of_cicp(_SRGB))
    return difference(lab_of(evidence.encoding, grid()), lab_of(srgb, grid())) > _ALIKE


def is_described(image: Image) -> bool:
    """Whether an untagged part describes its colors, other than by a tag."""
    specs = [part.spec for part in image.parts]
    return any(not spec.get_string_attribute(TAG) and evidence_in(spec) is not None for spec in specs)


def plain(name: str) -> str:
    """A name without case and punctuation."""
    return re.sub(r"[^a-z0-9]", "", name.lower())


@functools.cache
def grid() -> np.ndarray:
    """(n, 3) values from dark to light."""
    steps = np.array([0.02, 0.1, 0.3, 0.6, 1.0])
    return np.stack(np.meshgrid(steps, steps, steps), -1).reshape(-1, 3)


def lab_of(encoding: Encoding, values: np.ndarray) -> np.ndarray:
    """CIE Lab D65 of encoded values."""
    return lab_of_xyz(adapted(encoding.xyz(values), D50, D65) / np.array(D65))


def difference(a: np.ndarray, b: np.ndarray) -> float:
    """The largest distance in Lab."""
    return float(np.nan_to_num(np.linalg.norm(a - b, axis=-1), nan=np.inf).max())
