# SPDX-License-Identifier: Apache-2.0
"""Panels of `--texpreview` that show a material in light, from maps of any size, reduced to the panel's."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from ...engine.color.lens import Lens
from ...engine.color.srgb import decoded, lab_of_linear, srgb_of_lab
from ...engine.core.image import Image, Part, channels_of
from ...engine.deferred import np
from ...engine.errors import ImageError
from ..capture.occlusion import relief_of, visible_sky
from .lighting import FLAT, ROUGHNESS, LitMaterial, slope_normals, unit_normals
from .tile_preview import PreviewPanel, few_at_once, fitted, laid, look_through

_PX_BYTES = 320  # per pixel of a panel, measured
_VALUES = 24  # per pixel of a panel, while a row is shaded
_REACH = 32  # px of the tile at which heights occlude, as --texestimateao's


def roles_of(kinds: list[str]) -> list[str]:
    """The role of each map of a material, by its kind: the first data is roughness, the second metalness.

    Raises
    ------
    ImageError
        There are more maps of a kind than roles.
    """
    names = {"color": ["color"], "normal": ["normal"], "height": ["height"], "data": ["roughness", "metal"]}
    try:
        return [names[kind].pop(0) for kind in kinds]
    except IndexError:
        raise ImageError("too many maps: expected at most one color, normal and height, and two data") from None


def lit_bytes(height: int, width: int) -> int:
    """Memory of the maps of a material, reduced to a panel's size."""
    return _PX_BYTES * height * width


def lit_material(tile: np.ndarray, lens: Lens, maps: Mapping[str, Image], hand: str, height: int) -> LitMaterial:
    """The material of a reduced tile and of further maps, which are reduced to that height here.

    Parameters
    ----------
    tile : (h, w, channels) float
        In its own color space. `lens` converts it to Lab.
    maps : mapping of role to Image
    hand : str
        Convention of normals: 'opengl' or 'directx'.
    """
    lab, _ = lens.values(tile.astype(np.float32))
    seen = {role: _reduced(image, height) for role, image in maps.items()}
    plain = {"roughness": ROUGHNESS, "metal": 0.0, "ao": 1.0}
    scalars = {role: np.full((1, 1, 1), value, np.float32) for role, value in plain.items()}
    scalars |= {role: np.clip(seen[role][..., :1], 0, 1) for role in ("roughness", "metal") if role in seen}
    normal = np.array([[FLAT]], np.float32)
    if "height" in seen:
        part = maps["height"].first
        heights = seen["height"][..., 0] * np.float32(relief_of(part.spec) * height / part.spec.height)
        normal = slope_normals(heights)
        reach = max(2, min(heights.shape[0], round(_REACH * height / part.spec.height)))
        scalars["ao"] = visible_sky(np.pad(heights, reach, mode="wrap"), reach)[..., None]
    if "normal" in seen:
        if seen["normal"].shape[2] < 3:
            raise ImageError(f"a normal map has {seen['normal'].shape[2]} channels: expected 3")
        normal = unit_normals(seen["normal"], hand)
    color = decoded(srgb_of_lab(lab[..., :3])).astype(np.float32)
    return LitMaterial(color, normal, scalars["roughness"], scalars["metal"], scalars["ao"])


def _reduced(image: Image, height: int) -> np.ndarray:
    """The color channels of a map, scaled to a height as a tile is: (height, width, channels) float32."""
    part = image.first
    panel = whole_panel(part, height)
    look_through(part, [panel], image.source)
    return panel.rows(0, fitted(part.window.size, height)[1])[..., list(channels_of(part.spec).color)].astype(
        np.float32
    )


def whole_panel(part: Part, height: int) -> PreviewPanel:
    """A tile scaled to a height."""
    return laid(part.window.size, part.spec.nchannels, 1, height, in_memory=True)


@dataclass(frozen=True)
class LitPanels:
    """Panels of one height, in the color space of a tile with that number of channels."""

    material: LitMaterial
    lens: Lens
    channels: int
    height: int

    def lit(self) -> PreviewPanel:
        """The tile from above."""
        high, width = self.material.color.shape[:2]

        def rows(first: int, end: int) -> np.ndarray:
            light = np.zeros((end - first, width, 4), np.float32)
            last = min(end, high)  # below a very wide tile it is black
            if first < last:
                light[: last - first, :, :3] = self.material.flat(width, high, first, last)
                light[: last - first, :, 3] = 1
            return self._stored(light)

        return PreviewPanel(width, few_at_once(rows, _VALUES * width))

    def sphere(self) -> PreviewPanel:
        """The tile on a sphere, four times around; around it is black."""

        def rows(first: int, end: int) -> np.ndarray:
            return self._stored(self.material.sphere(self.height, first, end))

        return PreviewPanel(self.height, few_at_once(rows, 4 * _VALUES * self.height))

    def _stored(self, light: np.ndarray) -> np.ndarray:
        """Linear light with its coverage, (rows, width, 4), as values of the tile; without alpha it fades to black."""
        covered = light[..., 3]
        plain = np.zeros((*light.shape[:2], self.channels), np.float32)
        color = light[..., :3]
        if self.lens.channels.alpha is not None:
            plain[..., self.lens.channels.alpha] = covered
            color = color / np.maximum(covered, 1e-6)[..., None]
        lab = np.concatenate([lab_of_linear(color), covered[..., None]], axis=-1, dtype=np.float32)
        return self.lens.replaced(plain, lab, None)
