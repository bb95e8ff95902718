# SPDX-License-Identifier: Apache-2.0
"""What a file says about its colors, other than by the name of a space: a profile, primaries, CICP codes, Exif.

OpenImageIO's readers tag most 8-bit files as sRGB, also those that say otherwise. Such a tag is removed as the file is
read (`contradicted`); an op that needs colors finds the space of the config with the same colors (`space_described`).
"""

from __future__ import annotations

import functools
import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

from ..core.attributes import TAG
from ..core.image import Image, Part
from ..deferred import np, oiio
from ..errors import ColorError
from .icc import Encoding, adapted, of_cicp, of_primaries, of_profile
from .srgb import WHITE

if TYPE_CHECKING:
    from .config import ColorConfig

_ALIKE = 0.5  # largest difference in Lab of two descriptions of the same space: rounding of their numbers
_NEAR = 2.5  # the same of a space and a profile whose numbers are coarse
_NAMED = 10.0  # the same of a space that has the profile's name, which may have a simpler curve, as gamma 2.2 for sRGB
_PROFILES = {  # names that profiles of a space have everywhere
    "displayp3": "srgb_p3d65_scene",
    "adobergb1998": "g22_adobergb_scene",
    "srgbiec6196621": "srgb_rec709_scene",
}
_SRGB = (1, 13)  # CICP
_D50 = (0.9642, 1.0, 0.8249)
_NOT_SRGB = (2, 65535)  # Exif:ColorSpace: Adobe RGB by convention, uncalibrated


@dataclass(frozen=True)
class Evidence:
    """A description of colors: its kind and name for messages, and its encoding if that is known."""

    text: str
    name: str = ""
    encoding: Encoding | None = None


def evidence_in(spec: oiio.ImageSpec) -> Evidence | None:
    """What the metadata says, by the precedence of PNG (third edition, 4.3); None: nothing."""
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
        return "srgb" not in _plain(evidence.name)
    srgb = of_cicp(_SRGB)
    assert srgb is not None
    return _difference(_lab(evidence.encoding, _grid()), _lab(srgb, _grid())) > _ALIKE


def space_described(spec: oiio.ImageSpec, config: ColorConfig) -> str:
    """The config's space with the colors that the metadata describes: the nearest, else by name; empty: none.

    Scene-referred spaces are preferred.
    """
    evidence = evidence_in(spec)
    if evidence is None:
        return ""
    named = _space_named(evidence.name, config)
    if evidence.encoding is None:
        return named
    wanted, labs = _lab(evidence.encoding, _grid()), _labs(config)
    differences = {name: _difference(wanted, lab) for name, lab in labs.items()}
    best = min(differences, key=differences.__getitem__, default="")
    if differences.get(best, np.inf) <= _NEAR:
        return best
    return named if differences.get(named, np.inf) <= _NAMED else ""


def believed(image: Image, config: ColorConfig) -> Image:
    """The image with each untagged part tagged as its metadata describes it, if the config has such a space."""

    def tagged(part: Part) -> Part:
        if part.spec.get_string_attribute(TAG):
            return part
        space = space_described(part.spec, config)
        return part.respecced(lambda spec: spec.attribute(TAG, space)) if space else part

    parts = tuple(map(tagged, image.parts))
    same = all(part is own for part, own in zip(parts, image.parts, strict=True))
    return image if same else Image(parts, image.source)


def is_described(image: Image) -> bool:
    """Whether an untagged part describes its colors, so that `believed` may tag it."""
    specs = [part.spec for part in image.parts]
    return any(not spec.get_string_attribute(TAG) and evidence_in(spec) is not None for spec in specs)


def refusal(spec: oiio.ImageSpec, config: ColorConfig, source: str, hint: str) -> ColorError | None:
    """The error for an image whose description matches no space; None without a description."""
    evidence = evidence_in(spec)
    if evidence is None:
        return None
    return ColorError(f"has {evidence.text}, which matches no color space of {config.path}", subject=source, hint=hint)


def _plain(name: str) -> str:
    """A name without case and punctuation."""
    return re.sub(r"[^a-z0-9]", "", name.lower())


def _space_named(name: str, config: ColorConfig) -> str:
    """The config's space of that name, or of the space that such profiles have; empty: there is none."""
    plain = _plain(name)
    for space in config.config.getColorSpaces() if plain else ():
        if not space.isData() and plain in map(_plain, (space.getName(), *space.getAliases())):
            named: str = space.getName()
            return named
    try:
        return config.resolve(_PROFILES[plain]) if plain in _PROFILES else ""
    except ColorError:
        return ""


@functools.lru_cache(maxsize=4)
def _labs(config: ColorConfig) -> dict[str, np.ndarray]:
    """Lab of the grid in each space of the config, scene-referred spaces first."""
    labs, spaces = {}, [space for space in config.config.getColorSpaces() if not space.isData()]
    for space in sorted(spaces, key=lambda one: one.getReferenceSpaceType().value):
        values = _grid().astype(np.float32)
        try:
            config.to_lab(space.getName())(values)
        except ColorError:
            continue
        labs[space.getName()] = values
    return labs


@functools.cache
def _grid() -> np.ndarray:
    """(n, 3) values from dark to light."""
    steps = np.array([0.02, 0.1, 0.3, 0.6, 1.0])
    return np.stack(np.meshgrid(steps, steps, steps), -1).reshape(-1, 3)


def _lab(encoding: Encoding, values: np.ndarray) -> np.ndarray:
    """CIE Lab D65 of encoded values."""
    xyz = adapted(encoding.xyz(values), _D50, WHITE) / np.array(WHITE)
    f = np.where(xyz > (6 / 29) ** 3, np.cbrt(xyz), xyz / (3 * (6 / 29) ** 2) + 4 / 29)
    return np.stack([116 * f[:, 1] - 16, 500 * (f[:, 0] - f[:, 1]), 200 * (f[:, 1] - f[:, 2])], -1)


def _difference(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.nan_to_num(np.linalg.norm(a - b, axis=-1), nan=np.inf).max())
