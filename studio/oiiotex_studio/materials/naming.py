# SPDX-License-Identifier: Apache-2.0
"""Reads roles of maps from file names, by the conventions of Poly Haven, ambientCG, Megascans and Substance.

`aerial_rocks_02_nor_gl_2k.exr`, `Rock053_2K-JPG_NormalGL.jpg`, `tlzxbbr_2K_Albedo.jpg`, `Wall_Base_Color.png`: the name
of the material, then the role, with size and format before or after it. Other names are not guessed.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import NamedTuple

COLORS = ("color", "specular", "emission")  # color roles; all others are data
PACKED = "arm"  # ambient occlusion, roughness and metalness as red, green and blue
PACKED_ROLES = ("ao", "roughness", "metal")
ROLES: dict[str, tuple[str, ...]] = {
    "color": ("diff", "diffuse", "col", "color", "colour", "albedo", "base color", "base colour", "basecolor"),
    "normal": ("nor", "nrm", "norm", "normal", "normals", "nml"),
    "roughness": ("rough", "roughness", "rgh"),
    "gloss": ("gloss", "glossiness"),
    "metal": ("metal", "metallic", "metalness"),
    "ao": ("ao", "ambient occlusion", "ambientocclusion", "occlusion"),
    "height": ("disp", "displacement", "height"),
    "opacity": ("opacity", "alpha"),
    "specular": ("spec", "specular"),
    "emission": ("emission", "emissive"),
    PACKED: ("arm", "orm"),
}
HANDS: dict[str, tuple[str, ...]] = {
    "opengl": ("gl", "ogl", "opengl", "open gl"),
    "directx": ("dx", "directx", "direct x"),
}
_WORDS = re.compile(r"\d+x\d+|\d+[A-Za-z]*|[A-Z]+(?![a-z])\d*|[A-Z]?[a-z]+\d*")
_MARK = re.compile(r"\d{1,2}k|\d+x\d+|(8|16|32)bit|jpe?g|png|exr|tiff?", re.IGNORECASE)


class Name(NamedTuple):
    """A parsed file name.

    Attributes
    ----------
    material : str
        Rest of the stem; '' if the name is only a role.
    role : str
        One of `ROLES`; '' if the name has none.
    hand : str
        Convention of a normal map: 'opengl', 'directx' or ''.
    marks : tuple of str
        Words of size and format, in lower case.
    """

    material: str
    role: str = ""
    hand: str = ""
    marks: tuple[str, ...] = ()


def read_name(stem: str, further: Mapping[str, Sequence[str]] | None = None) -> Name:
    """Parse the stem of a file name.

    Parameters
    ----------
    stem : str
        File name without folder and extension.
    further : mapping of role to words, optional
        Additional words for roles, in lower case.
    """
    found = list(_WORDS.finditer(stem))
    words = [match[0].lower() for match in found]
    marks = _drop_marks(words)
    hand = _drop_last(words, HANDS)
    phrases = {role: (*own, *(further or {}).get(role, ())) for role, own in ROLES.items()}
    role = _drop_last(words, phrases)
    if hand and role != "normal":  # the word did not denote a normal convention
        words = [match[0].lower() for match in found]
        marks, hand, role = _drop_marks(words), "", ""
    if role:
        marks += _drop_marks(words)
    end = found[len(words)].start() if len(words) < len(found) else len(stem)
    return Name(stem[:end].rstrip("_-. ") if end < len(stem) else stem, role, hand, tuple(marks))


def _drop_marks(words: list[str]) -> list[str]:
    """Remove words of size and format from the end, and return them."""
    marks = []
    while words and _MARK.fullmatch(words[-1]):
        marks.append(words.pop())
    return marks


def _drop_last(words: list[str], phrases: Mapping[str, Sequence[str]]) -> str:
    """Remove the longest known phrase from the end, and return its key; '' if there is none."""
    for length in (2, 1):
        last = " ".join(words[-length:])
        for name, own in phrases.items():
            if len(words) >= length and last in own:
                del words[-length:]
                return name
    return ""
