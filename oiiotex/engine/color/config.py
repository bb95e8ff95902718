# SPDX-License-Identifier: Apache-2.0
"""Color spaces: their names, and conversion between file color space and CIE Lab D65. Only here is OpenColorIO used."""

from __future__ import annotations

import copy
import functools
import os
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from ..core.attributes import TAG, UNKNOWN
from ..core.image import Image, channels_of
from ..core.parameters import nearest
from ..deferred import np, ocio, oiio
from ..errors import COLORSPACE, IS_DATA, ColorError, ImageError, either, one_line
from ..shipped import shipped
from .described import believed, refusal, space_described
from .normal_maps import warn_of_normals
from .transform_files import require_config, require_files

# OpenImageIO embeds another OpenColorIO than PyOpenColorIO, so 'ocio://default' would mean two configs.
DEFAULT_CONFIG = "ocio://cg-config-v4.0.0_aces-v2.0_ocio-v2.5"
_LOADED = {0x0205: DEFAULT_CONFIG}  # by OpenImageIO, by the release of its OpenColorIO
INTERCHANGE_SPACES = ("lin_rec709", "ACES2065-1", "CIE XYZ D65")  # in our own config
_INTERCHANGE = either("--interchange SPACE lin_rec709", "Session(interchange=(SPACE, 'lin_rec709'))")
_HINT = f"name its linear Rec. 709, ACES2065-1 or CIE XYZ D65 space: {_INTERCHANGE}"
_BIT_DEPTHS = {
    "BIT_DEPTH_UINT8": ("uint8", 8), "BIT_DEPTH_UINT10": ("uint16", 10), "BIT_DEPTH_UINT12": ("uint16", 12),
    "BIT_DEPTH_UINT16": ("uint16", 16), "BIT_DEPTH_F16": ("half", 16), "BIT_DEPTH_F32": ("float", 32),
}  # fmt: skip
_SPACES_OF_FORMATS = dict.fromkeys((".jpg", ".jpeg", ".gif", ".webp"), "srgb_rec709_scene")
_SPACES_OF_FORMATS |= dict.fromkeys((".ppm", ".pnm"), "Rec709")


class ColorConfig:
    """The user's color config: `path`, else $OCIO, else a built-in one.

    `interchange` is for configs without interchange roles (OCIO v1): one of their spaces, and the space of
    `INTERCHANGE_SPACES` with the same colors.

    Raises
    ------
    ColorError
        The config cannot be loaded.
    """

    def __init__(self, path: str | None = None, interchange: tuple[str, str] | None = None):
        self.path = path or os.environ.get("OCIO") or DEFAULT_CONFIG
        require_config(self.path)
        try:
            self._config = (_built_in if self._is_built_in else _loaded)(self.path)
        except (ocio.Exception, ocio.ExceptionMissingFile, UnicodeDecodeError) as error:
            raise ColorError(f"{self.path}: cannot load the color config: {one_line(str(error))}") from error
        self.require_files()
        self._names = (_built_in_names if self._is_built_in else oiio.ColorConfig)(self.path)
        if interchange is not None and interchange[1] not in INTERCHANGE_SPACES:
            expected = f"one of {', '.join(INTERCHANGE_SPACES)}"
            raise ColorError(f"unknown interchange space '{interchange[1]}'", expected=expected)
        self._doubted: set[str] | None = set()
        self._interchange = (self.resolve(interchange[0]), interchange[1]) if interchange else None

    @property
    def _is_built_in(self) -> bool:
        return self.path.startswith("ocio://")

    def require_files(self, variables: dict[str, str] | None = None, names: Iterable[str] = ()) -> None:
        """Refuse files that OpenColorIO would open, as in `transform_files`."""
        if not self._is_built_in or names:  # built-in configs name no files
            require_files(self._config, variables or {}, names)

    def resolve(self, name: str) -> str:
        """The config's name of a color space, given its name, role or alias, or a name from OCIO's built-in configs.

        For example, 'Utility - sRGB - Texture' of older ACES configs is found in a config with srgb_rec709_scene, and
        vice versa.

        Raises
        ------
        ColorError
            The config has no such color space.
        """
        space = self._space(name) or self._space_called(name)
        if space is None:
            raise ColorError(
                f"color space '{name}' is not in {self.path}{nearest(name, self._all_names())}"
                f"{either('; oiiotex --colorconfiginfo lists them', '')}"
            )
        return space.getName()

    def has(self, name: str) -> bool:
        """Whether `resolve` finds a space."""
        return bool(self._space(name) or self._space_called(name))

    def known_name(self, name: str) -> str:
        """OpenImageIO's name of a space that `resolve` finds; the given name if OpenImageIO knows it, or none."""
        space = None if self._space(name) else self._space_called(name)
        return space.getName() if space else name

    def _space(self, name: str) -> ocio.ColorSpace | None:
        """The color space by a name that the config or OpenImageIO knows."""
        return self._config.getColorSpace(name) or self._config.getColorSpace(self._names.resolve(name))

    def _space_called(self, name: str) -> ocio.ColorSpace | None:
        """The config's space under another of its names in OCIO's built-in configs."""
        if name == "data":  # OpenImageIO's name for maps other than color
            return next((space for space in self._config.getColorSpaces() if space.isData()), None)
        known = None if _with_most_names().hasRole(name) else _with_most_names().getColorSpace(name)
        names = (known.getName(), *known.getAliases()) if known else ()
        spaces = (self._config.getColorSpace(other) for other in names if not self._config.hasRole(other))
        return next(filter(None, spaces), None)

    def _all_names(self) -> list[str]:
        """Names of spaces, aliases and roles, and those that only OpenImageIO knows."""
        names = [name for space in self._config.getColorSpaces() for name in (space.getName(), *space.getAliases())]
        known = [name for name in ("sRGB", "Rec709", "linear") if self._space(name)]
        return [*known, *names, *self._config.getRoleNames()]

    def roles_and_spaces(self) -> list[str]:
        """The names that a menu shows: roles, then color spaces."""
        return [*self._config.getRoleNames(), *(space.getName() for space in self._config.getColorSpaces())]

    def warn_once(self, image: Image) -> None:
        """Warn, once per image, if it is used as color but looks like a normal map."""
        if self._doubted is not None and image.source not in self._doubted and warn_of_normals(image):
            self._doubted.add(image.source)

    def unwarned(self) -> ColorConfig:
        """A copy that reads no pixels: it warns of no image."""
        config = copy.copy(self)
        config._doubted = None
        return config

    def described(self, spec: oiio.ImageSpec) -> str:
        """The space that the metadata describes, by a profile, CICP, chromaticities or Exif; empty: none."""
        return space_described(spec, self)

    def believed(self, image: Image) -> Image:
        """The image with untagged parts tagged as their metadata describes them."""
        return believed(image, self)

    @property
    def path_of_names(self) -> str:
        """The path to call OpenImageIO's functions with; empty if it is the one built-in config that they keep.

        They load any other with each call, which takes 20 ms; and that one, too, if they are given an empty path.
        """
        loaded = oiio.ColorConfig.default_colorconfig().configname()
        if loaded == "ocio://default":
            loaded = _LOADED.get(oiio.OpenColorIO_version_hex >> 16, loaded)
        return "" if self._is_built_in and self.path == loaded else self.path

    @property
    def config(self) -> ocio.Config:
        """The OpenColorIO config."""
        return self._config

    @property
    def names(self) -> oiio.ColorConfig:
        """OpenImageIO's view of the config: displays, views, looks, transforms."""
        return self._names

    def is_data(self, name: str) -> bool:
        """Whether the color space is a data space."""
        return self._config.getColorSpace(self.resolve(name)).isData()

    def space_by_file_rules(self, path: str) -> str | None:
        """The color space that the config's file rules give to a file name; None if only the default rule matches."""
        if self._config.filepathOnlyMatchesDefaultRule(path):
            return None
        return self._config.getColorSpaceFromFilepath(path)[0]

    # --- for --autocc ---

    @property
    def linear(self) -> str | None:
        """The scene-linear space; None without that role."""
        space = self._config.getColorSpace(ocio.ROLE_SCENE_LINEAR)
        return space.getName() if space else None

    def same(self, a: str, b: str) -> bool:
        """Whether two names mean the same colors."""
        return self._names.equivalent(a, b)

    def space_in_name(self, path: str) -> str | None:
        """The color space in a file name: by the file rules, or because it contains the space's name."""
        space = self._names.getColorSpaceFromFilepath(path, "", True)
        return None if space in ("", "unknown") else space

    def space_of_output(self, path: str) -> str | None:
        """The color space of an output file: from its name, else the usual one of its format."""
        return self.space_in_name(path) or _SPACES_OF_FORMATS.get(os.path.splitext(path)[1].lower())

    def pixel_type(self, name: str) -> tuple[oiio.TypeDesc, int] | None:
        """The pixel type, and its significant bits, that the config recommends for a space."""
        space = self._config.getColorSpace(self._names.resolve(name))
        depth = _BIT_DEPTHS.get(space.getBitDepth().name) if space else None
        return (oiio.TypeDesc(depth[0]), depth[1]) if depth else None

    @functools.lru_cache(maxsize=8)  # noqa: B019 - lives as long as the config, which lives as long as the run
    def to_lab(self, name: str) -> Callable[[np.ndarray], None]:
        """A function that converts contiguous (..., 3) float32 of this space to Lab in place.

        Lossless: OCIO's default optimization is forty times less exact here. Arrays of (..., 4), whose last value is
        not changed, are twice as fast and yield the same bits.
        """
        return self._converter(name, forward=True)

    @functools.lru_cache(maxsize=8)  # noqa: B019
    def from_lab(self, name: str) -> Callable[[np.ndarray], None]:
        """The inverse of `to_lab`: a function that converts Lab to this space in place.

        A round trip changes a value by less than 1e-5 of the pixel's brightest channel in linear spaces, 3e-4 in sRGB.
        """
        return self._converter(name, forward=False)

    def _converter(self, name: str, forward: bool) -> Callable[[np.ndarray], None]:
        source: tuple[Any, ...] = self._config, self.resolve(name)
        target: tuple[Any, ...] = _lab_config(), "Lab"
        if self._interchange is not None:
            source, target = (*source, self._interchange[0]), (*target, self._interchange[1])
        try:
            processor = ocio.Config.GetProcessorFromConfigs(*(source + target if forward else target + source))
            on_cpu = processor.getOptimizedCPUProcessor(ocio.OPTIMIZATION_LOSSLESS)
        except (ocio.Exception, ocio.ExceptionMissingFile) as error:
            way = f"from '{name}' to CIE Lab" if forward else f"from CIE Lab to '{name}'"
            hint = "" if self._interchange or self._config.hasRole("aces_interchange") else _HINT
            raise ColorError(f"cannot convert {way}: {one_line(str(error))}", hint=hint) from error

        def convert(values: np.ndarray) -> None:
            (on_cpu.applyRGBA if values.shape[-1] == 4 else on_cpu.applyRGB)(values)

        return convert


def _loaded(path: str) -> ocio.Config:
    config = ocio.Config.CreateFromFile(path)
    if os.path.exists(path) and not path.endswith(".ocioz"):
        Path(path).read_text("utf-8")  # otherwise the bindings fail later, at the first name that is not UTF-8
    return config


@functools.cache  # it takes 6 ms to load, and never changes
def _built_in(path: str) -> ocio.Config:
    return _loaded(path)


@functools.cache  # the first name that is asked for takes 20 ms
def _built_in_names(path: str) -> oiio.ColorConfig:
    return oiio.ColorConfig(path)


def _with_most_names() -> ocio.Config:
    """OCIO's built-in config with the most names, including older ACES ones."""
    return _built_in("ocio://studio-config-v4.0.0_aces-v2.0_ocio-v2.5")


@functools.cache
def _lab_config() -> ocio.Config:
    return ocio.Config.CreateFromStream((shipped("ocio", "ocio") / "oiiotex.ocio").read_text())


def space_of(image: Image, config: ColorConfig, autocc: bool = False) -> str:
    """The image's color space: its tag, else its profile, else with `autocc` by the config's file rules."""
    tag = image.first.spec.get_string_attribute(TAG)
    if tag and (tag != UNKNOWN or config.has(tag)):
        return config.resolve(tag)
    described = config.described(image.first.spec)
    if described:
        return described
    by_name = config.space_by_file_rules(image.source) if autocc else None
    if by_name is None:
        hint = f"add {COLORSPACE}{either(' after it', '')}, or {IS_DATA} for maps other than color"
        raise refusal(image.first.spec, config, image.source, hint) or ColorError(
            f"has no color space tag ('{TAG}')", subject=image.source, hint=hint
        )
    return by_name


def color_space(image: Image, config: ColorConfig | None, autocc: bool = False) -> str | None:
    """The image's color space, or None if its channels are data: without a config, or in a data space.

    Raises
    ------
    ImageError
        The image has neither one nor three color channels.
    ColorError
        As by `space_of`.
    """
    if config is None:
        return None
    space = space_of(image, config, autocc)
    if config.is_data(space):
        return None
    config.warn_once(image)
    count = len(channels_of(image.first.spec).color)
    if count not in (1, 3):
        raise ImageError(
            f"has {count} channels without alpha",
            subject=image.source,
            expected="1 or 3 color channels",
            hint=f"add {IS_DATA} for maps other than color",
        )
    return space


def as_float(rows: np.ndarray) -> np.ndarray:
    """Pixel values as OpenImageIO interprets them: integers as fractions of their type's largest value."""
    if rows.dtype.kind in "ui":
        return rows.astype(np.float32) * np.float32(1.0 / np.iinfo(rows.dtype).max)
    return rows.astype(np.float32)
