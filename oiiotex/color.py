# SPDX-License-Identifier: Apache-2.0
"""Colour spaces: the only room that knows OpenColorIO. File colour space <-> CIE Lab D65, or data left alone."""

from __future__ import annotations

import functools
import os
from collections.abc import Callable
from dataclasses import dataclass
from importlib import resources

import numpy as np
import OpenImageIO as oiio
import PyOpenColorIO as ocio

from .errors import ColorError, ImageError
from .images import Channels, Image, channels_of
from .tiles import bands

# OpenImageIO embeds another OpenColorIO than PyOpenColorIO, so 'ocio://default' would mean two configs.
DEFAULT_CONFIG = "ocio://cg-config-v4.0.0_aces-v2.0_ocio-v2.5"
TAG = "oiio:ColorSpace"
INTERCHANGE_SPACES = ("lin_rec709", "ACES2065-1", "CIE XYZ D65")  # of our own config
_HINT = "; --interchange SPACE lin_rec709 says which of its spaces is linear Rec. 709 (or ACES2065-1, 'CIE XYZ D65')"
_BIT_DEPTHS = {
    ocio.BIT_DEPTH_UINT8: (oiio.TypeDesc(oiio.UINT8), 8), ocio.BIT_DEPTH_UINT10: (oiio.TypeDesc(oiio.UINT16), 10),
    ocio.BIT_DEPTH_UINT12: (oiio.TypeDesc(oiio.UINT16), 12), ocio.BIT_DEPTH_UINT16: (oiio.TypeDesc(oiio.UINT16), 16),
    ocio.BIT_DEPTH_F16: (oiio.TypeDesc(oiio.HALF), 16), ocio.BIT_DEPTH_F32: (oiio.TypeDesc(oiio.FLOAT), 32),
}  # fmt: skip


class ColorConfig:
    """The user's colour config: `path`, else $OCIO, else a built-in one.

    `interchange` is for configs that do not say how they meet others (OCIO v1): one of their spaces, and that of
    `INTERCHANGE_SPACES` which means the same colours.

    Raises
    ------
    ColorError
        The config cannot be loaded.
    """

    def __init__(self, path: str | None = None, interchange: tuple[str, str] | None = None):
        self.path = path or os.environ.get("OCIO") or DEFAULT_CONFIG
        try:
            self._config = ocio.Config.CreateFromFile(self.path)
        except (ocio.Exception, ocio.ExceptionMissingFile) as error:
            raise ColorError(
                f"{self.path}: not a colour config that can be used: {' '.join(str(error).split())}"
            ) from error
        self._names = oiio.ColorConfig(self.path)  # knows the names that OpenImageIO tags files with
        if interchange is not None and interchange[1] not in INTERCHANGE_SPACES:
            allowed = ", ".join(INTERCHANGE_SPACES)
            raise ColorError(f"no interchange space '{interchange[1]}'; there is {allowed}")
        self._interchange = (self.resolve(interchange[0]), interchange[1]) if interchange else None

    def resolve(self, name: str) -> str:
        """The config's own name of a colour space, role or alias.

        Raises
        ------
        ColorError
            The config has none of that name.
        """
        space = self._config.getColorSpace(name) or self._config.getColorSpace(self._names.resolve(name))
        if space is None:
            raise ColorError(f"colour space '{name}' is not in {self.path}")
        return space.getName()

    @property
    def names(self) -> oiio.ColorConfig:
        """What OpenImageIO finds in the config: displays, views, looks, transforms."""
        return self._names

    def is_data(self, name: str) -> bool:
        """Whether the space says that its values are no colours."""
        return self._config.getColorSpace(self.resolve(name)).isData()

    def space_by_file_rules(self, path: str) -> str | None:
        """What the config's file rules say of a file's name; None where only the default rule would speak."""
        if self._config.filepathOnlyMatchesDefaultRule(path):
            return None
        return self._config.getColorSpaceFromFilepath(path)[0]

    # --- what --autocc asks ---

    @property
    def linear(self) -> str | None:
        """The scene-linear space, where the config has the role."""
        space = self._config.getColorSpace(ocio.ROLE_SCENE_LINEAR)
        return space.getName() if space else None

    def same(self, a: str, b: str) -> bool:
        """Whether two names mean the same colours."""
        return self._names.equivalent(a, b)

    def space_in_name(self, path: str) -> str | None:
        """The space that the name of a file says: by the file rules, or because it contains the space's name."""
        found = self._names.getColorSpaceFromFilepath(path, "", True)
        return None if found in ("", "unknown") else found

    def space_of_output(self, path: str) -> str | None:
        """The space that a file of that name should be in: as its name says, else as its format has it."""
        found = self.space_in_name(path)
        if found is None:
            suffix = os.path.splitext(path)[1].lower()
            found = "srgb_rec709_scene" if suffix in (".jpg", ".jpeg", ".gif", ".webp") else None
            found = "Rec709" if suffix in (".ppm", ".pnm") else found
        return found

    def pixel_type(self, name: str) -> tuple[oiio.TypeDesc, int] | None:
        """The pixel type, and its significant bits, that the config wants for a space."""
        space = self._config.getColorSpace(self._names.resolve(name))
        return _BIT_DEPTHS.get(space.getBitDepth()) if space else None

    @functools.lru_cache(maxsize=8)  # noqa: B019 - lives as long as the config, which lives as long as the run
    def to_lab(self, name: str) -> Callable[[np.ndarray], None]:
        """A function that turns contiguous (..., 3) float32 of that space into Lab in place.

        Lossless: OCIO's default optimisation is forty times less exact on this path. Arrays of (..., 4), whose last
        value stays as it is, go twice as fast and come to the same bits.
        """
        return self._converter(name, forward=True)

    @functools.lru_cache(maxsize=8)  # noqa: B019
    def from_lab(self, name: str) -> Callable[[np.ndarray], None]:
        """The inverse of `to_lab`: a function that turns Lab into that space in place.

        There and back moves a value by less than 1e-5 of the pixel's brightest channel in linear spaces, 3e-4 in sRGB.
        """
        return self._converter(name, forward=False)

    def _converter(self, name: str, forward: bool) -> Callable[[np.ndarray], None]:
        source, target = (self._config, self.resolve(name)), (_lab_config(), "Lab")
        if self._interchange is not None:
            source, target = (*source, self._interchange[0]), (*target, self._interchange[1])
        try:
            processor = ocio.Config.GetProcessorFromConfigs(*(source + target if forward else target + source))
            made = processor.getOptimizedCPUProcessor(ocio.OPTIMIZATION_LOSSLESS)
        except (ocio.Exception, ocio.ExceptionMissingFile) as error:
            way = f"from '{name}' to CIE Lab" if forward else f"from CIE Lab to '{name}'"
            hint = "" if self._interchange or self._config.hasRole("aces_interchange") else _HINT
            raise ColorError(f"no way {way}: {' '.join(str(error).split())}{hint}") from error

        def convert(values: np.ndarray) -> None:
            (made.applyRGBA if values.shape[-1] == 4 else made.applyRGB)(values)

        return convert


@functools.cache
def _lab_config() -> ocio.Config:
    return ocio.Config.CreateFromStream((resources.files("oiiotex.ocio") / "oiiotex.ocio").read_text())


@dataclass(frozen=True)
class Working:
    """A part in a filter's working space.

    Attributes
    ----------
    values : (height, width, 3) float32
        Lab (L 0 to 100 for diffuse white, a, b), or data scaled to 0 .. 100.
    opaque : (height, width) bool or None
        Where alpha is not 0; None where there is no alpha or it is nowhere 0.
    """

    values: np.ndarray
    opaque: np.ndarray | None


def space_of(image: Image, config: ColorConfig, autocc: bool = False) -> str:
    """The image's colour space: its tag, else the config's file rules where `autocc` asks for them.

    Raises
    ------
    ColorError
        Neither says; colour is never guessed.
    """
    tag = image.first.spec.get_string_attribute(TAG)
    if tag:
        return config.resolve(tag)
    by_name = config.space_by_file_rules(image.source) if autocc else None
    if by_name is None:
        raise ColorError(
            f"{image.source} does not say its colour space: add --iscolorspace NAME after it"
            f" (or set the attribute '{TAG}'), or :data=1 where its channels are no colours"
        )
    return by_name


def colour_space(image: Image, config: ColorConfig | None, autocc: bool = False) -> str | None:
    """The image's colour space, or None where its channels are data: without a config, or because the space says so.

    Raises
    ------
    ImageError
        Two channels that are to be taken as colour.
    ColorError
        As by `space_of`.
    """
    if config is None:
        return None
    space = space_of(image, config, autocc)
    if config.is_data(space):
        return None
    count = len(channels_of(image.first.spec).colour)
    if count not in (1, 3):
        raise ImageError(f"{image.source} has {count} channels beside alpha: no colour; add :data=1")
    return space


class BrokenValues(ImageError):
    """NaN or Inf where there should be colour. `counts` says how many of either: (2,) int64."""

    def __init__(self, name: str, counts: np.ndarray):
        super().__init__(f"{name} has {counts[0]} NaN and {counts[1]} Inf values: add --fixnan box3 after it")
        self.counts = counts


def working_values(image: Image, config: ColorConfig | None, autocc: bool = False) -> Working:
    """The image's first part as the filters see it.

    Parameters
    ----------
    image : Image
        Gray, gray + alpha, RGB, RGBA, with any further channels.
    config : ColorConfig or None
        None: the channels are data, scaled by their common range and never converted.
    autocc : bool
        Ask the config's file rules where the image has no tag.

    Raises
    ------
    ImageError
        NaN or Inf in its colour or alpha, or two channels that are to be taken as colour.
    ColorError
        As by `space_of`.
    """
    part = image.first
    channels = channels_of(part.spec)
    space = colour_space(image, config, autocc)
    convert = None if config is None or space is None else config.to_lab(space)
    values = np.zeros((part.spec.height, part.spec.width, 3), np.float32)
    alpha = np.ones((part.spec.height, part.spec.width), np.float32) if channels.alpha is not None else None
    broken = np.zeros(2, np.int64)
    used = [*channels.colour, *([] if channels.alpha is None else [channels.alpha])]
    for window in bands(part):
        place = window.inside(part.window)
        rows = as_float(part.read(window))
        seen = rows[..., used]  # depth and the like may well be infinite
        broken += np.isnan(seen).sum(), np.isinf(seen).sum()
        _fill(values[place], None if alpha is None else alpha[place], rows, channels)
        if convert is not None and not broken.any():
            convert(values[place])
    if broken.any():
        raise BrokenValues(image.source, broken)
    opaque = None if alpha is None or alpha.all() else alpha != 0
    if convert is None:
        values = _scaled(values, opaque, 3 if len(channels.colour) == 1 else len(channels.colour))
    return Working(values, opaque)


def as_float(rows: np.ndarray) -> np.ndarray:
    """Pixel values as OpenImageIO means them: integers as shares of their type's largest value."""
    if rows.dtype.kind in "ui":
        return rows.astype(np.float32) * np.float32(1.0 / np.iinfo(rows.dtype).max)
    return rows.astype(np.float32)


def _fill(values: np.ndarray, alpha: np.ndarray | None, rows: np.ndarray, channels: Channels) -> None:
    """Unpremultiplied colour of `rows` into `values`, gray three times over."""
    colour = rows[..., list(channels.colour)]
    if channels.alpha is not None:
        alpha[:] = rows[..., channels.alpha]
        colour = colour / np.where(np.abs(alpha) < np.finfo(np.float32).tiny, np.float32(1.0), alpha)[..., None]
    values[..., : colour.shape[-1]] = colour
    if len(channels.colour) == 1:
        values[..., 1:] = colour


def _scaled(values: np.ndarray, opaque: np.ndarray | None, count: int) -> np.ndarray:
    """Data on Lab's scale: the common range of all channels becomes 0 .. 100, so that distances mean the same."""
    seen = (values if opaque is None else values[opaque])[..., :count]
    if seen.size == 0:
        return values
    low, high = float(seen.min()), float(seen.max())
    values[..., count:] = low
    return (values - np.float32(low)) * np.float32(100.0 / max(high - low, 1e-12))
