# SPDX-License-Identifier: Apache-2.0
"""The color space of a config that a file describes, by a profile, primaries, CICP codes or Exif (`io/evidence`)."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Protocol

from ..core.attributes import TAG
from ..core.image import Image, Part
from ..deferred import np, ocio, oiio
from ..errors import ColorError
from ..io.evidence import difference, evidence_in, grid, lab_of, plain

_NEAR = 2.5  # largest difference in Lab of a space and a description whose numbers are coarse
_NAMED = 10.0  # the same of a space that has the profile's name, which may have a simpler curve, as gamma 2.2 for sRGB
_PROFILES = {  # names that profiles of a space have everywhere
    "displayp3": "srgb_p3d65_scene",
    "adobergb1998": "g22_adobergb_scene",
    "srgbiec6196621": "srgb_rec709_scene",
}


class Spaces(Protocol):
    """What is needed of a color config."""

    path: str

    def __hash__(self) -> int: ...

    @property
    def config(self) -> ocio.Config:
        """The OpenColorIO config."""

    def resolve(self, name: str) -> str:
        """The config's name of a space."""

    def to_lab(self, name: str) -> Callable[[np.ndarray], None]:
        """A function that converts a space to Lab in place."""


def space_described(spec: oiio.ImageSpec, config: Spaces) -> str:
    """The config's space with the colors that the metadata describes: the nearest, else by name; empty: none.

    Scene-referred spaces are preferred.
    """
    evidence = evidence_in(spec)
    if evidence is None:
        return ""
    named = _space_named(evidence.name, config)
    if evidence.encoding is None:
        return named
    wanted, labs = lab_of(evidence.encoding, grid()), _labs(config)
    differences = {name: difference(wanted, lab) for name, lab in labs.items()}
    best = min(differences, key=differences.__getitem__, default="")
    if differences.get(best, np.inf) <= _NEAR:
        return best
    return named if differences.get(named, np.inf) <= _NAMED else ""


def believed(image: Image, config: Spaces) -> Image:
    """The image with each untagged part tagged as its metadata describes it, if the config has such a space."""

    def tagged(part: Part) -> Part:
        if part.spec.get_string_attribute(TAG):
            return part
        space = space_described(part.spec, config)
        return part.respecced(lambda spec: spec.attribute(TAG, space)) if space else part

    parts = tuple(map(tagged, image.parts))
    same = all(part is own for part, own in zip(parts, image.parts, strict=True))
    return image if same else Image(parts, image.source)


def refusal(spec: oiio.ImageSpec, config: Spaces, source: str, hint: str) -> ColorError | None:
    """The error for an image whose description matches no space; None without a description."""
    evidence = evidence_in(spec)
    if evidence is None:
        return None
    return ColorError(f"has {evidence.text}, which matches no color space of {config.path}", subject=source, hint=hint)


def _space_named(name: str, config: Spaces) -> str:
    """The config's space of that name, or of the space that such profiles have; empty: there is none."""
    bare = plain(name)
    for space in config.config.getColorSpaces() if bare else ():
        if not space.isData() and bare in map(plain, (space.getName(), *space.getAliases())):
            named: str = space.getName()
            return named
    try:
        return config.resolve(_PROFILES[bare]) if bare in _PROFILES else ""
    except ColorError:
        return ""


@functools.lru_cache(maxsize=4)
def _labs(config: Spaces) -> dict[str, np.ndarray]:
    """Lab of the grid in each space of the config, scene-referred spaces first."""
    labs, spaces = {}, [space for space in config.config.getColorSpaces() if not space.isData()]
    for space in sorted(spaces, key=lambda one: one.getReferenceSpaceType().value):
        values = grid().astype(np.float32)
        try:
            config.to_lab(space.getName())(values)
        except ColorError:
            continue
        labs[space.getName()] = values
    return labs
