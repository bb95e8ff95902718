# SPDX-License-Identifier: Apache-2.0
"""Shader functions for renderers, and a web page that shows the plane."""

from __future__ import annotations

import base64
import html
from importlib import resources
from pathlib import Path

SHADERS = ("sample_wang.glsl", "sample_wang.hlsl", "sample_wang.wgsl")
HEX_SHADERS = ("sample_hex.glsl", "sample_hex.hlsl", "sample_hex.wgsl")


def shader(name: str) -> str:
    """The text of a file of this package's folder of shaders."""
    return (resources.files(__package__) / "shaders" / name).read_text()


def viewer_page(name: str, atlas: Path, plane: Path, side: int, aspect: float) -> str:
    """A self-contained page with one tile repeated, the same tile hex-tiled, and the plane, to the horizon.

    Parameters
    ----------
    name : str
        Title.
    atlas, plane : Path
        PNG files: the atlas in sRGB, and the index image.
    side : int
        Tiles along a side of the atlas.
    aspect : float
        Width of a tile divided by its height.
    """
    values = {
        "NAME": html.escape(name), "SAMPLE_WANG": shader(SHADERS[0]), "SIDE": str(side), "ASPECT": f"{aspect:.9g}",
        "ATLAS": _as_url(atlas), "PLANE": _as_url(plane),
    }  # fmt: skip
    page = shader("viewer.html")
    for key, value in values.items():
        page = page.replace(f"@{key}@", value)
    return page


def _as_url(png: Path) -> str:
    return f"data:image/png;base64,{base64.b64encode(png.read_bytes()).decode()}"
