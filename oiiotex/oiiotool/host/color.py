# SPDX-License-Identifier: Apache-2.0
"""Color management, by OpenColorIO inside OpenImageIO."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

from ...engine.core.access import Pointwise
from ...engine.core.attributes import TAG, tag_colors
from ...engine.core.image import Image, Part, channels_of
from ...engine.core.parameters import Numbers, argument, image, param
from ...engine.deferred import np, oiio
from ...engine.errors import ColorError, ImageError, ParameterError
from ...engine.io.evidence import evidence_in
from ...engine.session.facts import Facts
from .kinds import HostOp, Respec, checked, op, pointwise, worked

log = logging.getLogger("oiiotex")

_KEY = param("", help="Comma-separated names of OCIO context variables.", example="SHOT", advanced=True)
_VALUE = param("", help="Comma-separated values of the variables named in key.", example="ab010", advanced=True)


@dataclass(frozen=True, kw_only=True)
class IsColorSpace(Respec):
    """Tag the image with a color space, without converting pixels."""

    name: ClassVar[str] = "iscolorspace"

    space: str = argument(  # type: ignore[misc, assignment]  # the user's value, where other ops declare their working space
        help="Color space, role or alias of the config. An empty string removes the tag.", example="ACEScg"
    )

    def called(self, spec: oiio.ImageSpec) -> None:
        """Set the color space, and erase metadata that contradicts it."""
        spec.set_colorspace(self.space)
        tag_colors(spec, self.space)

    def result(self, parts: Sequence[Part], facts: Facts) -> Part:
        """The part under its new spec."""
        if not self.space:
            return super().result(parts, facts)
        facts.color.resolve(self.space)
        known = replace(self, space=facts.color.known_name(self.space))
        return super(IsColorSpace, known).result(parts, facts)


@dataclass(frozen=True, kw_only=True)
class OnColor(HostOp, Pointwise):
    """Works on color alone: R, G, B (by name, else the first three) and alpha. Other channels are copied."""

    spares: ClassVar[bool] = True

    source: Image = image(help="Input image.")
    unpremult: bool = param(False, help="Divide color by alpha before the conversion, and multiply it afterwards.")

    def convert(self, color: oiio.ImageBuf, config: str) -> oiio.ImageBuf:
        """The conversion of up to four channels; `config` is `ColorConfig.path_of_names`."""
        raise NotImplementedError

    def space_of_result(self, tag: str) -> str:
        """The color space of the result, of which OpenImageIO says `tag`."""
        return tag

    def opened(self) -> Sequence[str]:
        """Files that the op names, for the config's search path."""
        return ()

    def known(self, names: oiio.ColorConfig) -> Sequence[str]:
        """Names of this kind in the config, listed in the error if the conversion fails."""
        return ()

    def result(self, parts: Sequence[Part], facts: Facts) -> Part:
        """The result, not yet computed. A conversion that does not exist is an error now."""
        path, config = facts.color.path, facts.color.path_of_names
        variables = zip(*(getattr(self, name, "").split(",") for name in ("key", "value")), strict=False)
        facts.color.require_files(dict(variables), self.opened())
        part = facts.color.believed(Image(tuple(parts[:1]), "")).first

        def convert(color: oiio.ImageBuf) -> oiio.ImageBuf:
            try:
                return checked(self.convert(color, config))
            except (ImageError, RuntimeError) as error:  # OpenImageIO may take braces in names for format fields
                known = ", ".join(self.known(facts.color.names))
                raise ColorError(f"{error} ({path}{f' has {known}' if known else ''})") from None

        made = pointwise((part,), part.window, lambda source: _converted(source, convert))
        spec = oiio.ImageSpec(made.spec)
        tag_colors(spec, self.space_of_result(spec.get_string_attribute(TAG)))
        return replace(made, spec=spec)


def _converted(source: oiio.ImageBuf, convert: Callable[[oiio.ImageBuf], oiio.ImageBuf]) -> oiio.ImageBuf:
    """The image with its color converted: OpenImageIO's functions corrupt channels after the fourth."""
    spec, channels = source.spec(), channels_of(source.spec())
    color, alpha = tuple(channels.color), () if channels.alpha is None else (channels.alpha,)
    if (*color, *alpha) == tuple(range(spec.nchannels)) and (not alpha or len(color) == 3):
        return convert(source)
    three = color * 3 if len(color) == 1 else (*color, 0.0)[:3]
    narrow = oiio.ImageBufAlgo.channels(source, (*three, *alpha), ("R", "G", "B", "A")[: 3 + len(alpha)])
    both = oiio.ImageBufAlgo.channel_append(checked(convert(narrow)), source)
    places = dict(zip(color, range(3), strict=False)) | dict.fromkeys(alpha, 3)  # in the converted image
    order = tuple(places.get(n, narrow.nchannels + n) for n in range(spec.nchannels))
    return oiio.ImageBufAlgo.channels(both, order, spec.channelnames)


def _space(given: str, spec: oiio.ImageSpec) -> str:
    """The color space that the user names. 'current' is the image's tag; without a tag it is an error, not a guess."""
    if given not in ("", "current"):
        return given
    tag = spec.get_string_attribute(TAG)
    if not tag:
        evidence = evidence_in(spec)
        if evidence is not None:
            problem = f"the image has {evidence.text}, which matches no color space of the config"
            raise ColorError(problem, hint="add --iscolorspace NAME before this op")
        raise ColorError("the image has no color space tag", hint="add --iscolorspace NAME before this op")
    return tag


def _end_of_view(use: Any, spec: oiio.ImageSpec) -> str:
    """The color space at the scene's end of a view; an inverse view of an untagged image ends in scene linear."""
    if use.inverse and use.from_ in ("", "current") and not spec.get_string_attribute(TAG):
        return "scene_linear"
    return _space(use.from_, spec)


# --- between color spaces ---


@dataclass(frozen=True, kw_only=True)
class Converting(OnColor):
    """Conversions between color spaces."""

    key: str = _KEY
    value: str = _VALUE
    strict: bool = param(True, help="Fail if the conversion does not exist. If 0, keep the pixels and print a warning.")

    def spaces(self) -> dict[str, str]:
        """From, to."""
        return {name: getattr(self, name, "current") for name in ("from_space", "to_space")}

    def convert(self, color: oiio.ImageBuf, config: str) -> oiio.ImageBuf:
        """In the other space."""
        source, target = self.spaces().values()
        source = _space(source, color.spec())
        context = self.key, self.value, config
        return oiio.ImageBufAlgo.colorconvert(
            color, source, target, self.unpremult, *(context if any(context) else ())
        )  # given empty strings, it loads the config again

    def result(self, parts: Sequence[Part], facts: Facts) -> Part:
        """The result, not yet computed."""
        names: dict[str, Any] = {n: facts.color.known_name(s) for n, s in self.spaces().items() if hasattr(self, n)}
        try:
            return super(Converting, replace(self, **names)).result(parts, facts)
        except ColorError as error:
            if self.strict:
                for name in {*self.spaces().values()} - {"", "current"}:
                    facts.color.resolve(name)  # its error has more detail
                raise
            log.warning("%s: %s; the pixels are not converted", self.flag(), error)
            return worked(parts[0])


@dataclass(frozen=True, kw_only=True)
class ColorConvert(Converting):
    """Convert from one color space to another."""

    name: ClassVar[str] = "colorconvert"

    from_space: str = argument(
        help="Color space, role or alias of the input. current: the image's color space tag.", example="sRGB"
    )
    to_space: str = argument(help="Color space, role or alias of the result.", example="ACEScg")

    def idle(self, parts: Sequence[Part]) -> bool:
        """Whether both color spaces are the same."""
        return self.from_space == self.to_space


@dataclass(frozen=True, kw_only=True)
class ToColorSpace(Converting):
    """Convert from the image's tagged color space to another."""

    name: ClassVar[str] = "tocolorspace"

    to_space: str = argument(help="Color space, role or alias of the result.", example="ACEScg")


# --- other transforms ---


@dataclass(frozen=True, kw_only=True)
class ColorMatrix(OnColor):
    """Multiply colors, as row vectors, by a 3x3 or 4x4 matrix."""

    name: ClassVar[str] = "ccmatrix"

    matrix: Numbers = argument(help="9 or 16 values, row by row.", example="0,0,1,0,1,0,1,0,0")
    transpose: bool = param(False, help="Transpose the matrix before it is inverted or applied.")
    invert: bool = param(False, help="Invert the matrix.")
    inverse: bool = param(False, help="Alias of invert.", advanced=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        self._matrix()

    def _matrix(self) -> np.ndarray:
        """(4, 4) float64."""
        size = {9: 3, 16: 4}.get(len(self.matrix))
        if size is None:
            raise ParameterError(parameter="matrix", value=self.matrix, expected="9 or 16 numbers")
        matrix: np.ndarray = np.eye(4)
        matrix[:size, :size] = np.reshape(self.matrix, (size, size))
        if self.transpose:
            matrix = matrix.T
        if self.invert or self.inverse:
            try:
                matrix = np.linalg.inv(matrix)
            except np.linalg.LinAlgError:
                raise ParameterError(parameter="matrix", value=self.matrix, expected="an invertible matrix") from None
        return matrix

    def convert(self, color: oiio.ImageBuf, config: str) -> oiio.ImageBuf:
        """The colors times the matrix."""
        return oiio.ImageBufAlgo.colormatrixtransform(color, tuple(self._matrix().ravel()), self.unpremult)


@dataclass(frozen=True, kw_only=True)
class FileTransform(OnColor):
    """Apply an OCIO file transform: a LUT, CLF or CDL."""

    name: ClassVar[str] = "ociofiletransform"

    file: str = argument(
        help="File of the transform: a path, or a name in the config's search path.", example="look.cdl"
    )
    inverse: bool = param(False, help="Apply the inverse transform.")

    def opened(self) -> Sequence[str]:
        """The file of the transform."""
        return (self.file,)

    def convert(self, color: oiio.ImageBuf, config: str) -> oiio.ImageBuf:
        """The colors after the transform."""
        return oiio.ImageBufAlgo.ociofiletransform(color, self.file, self.unpremult, self.inverse, config)


def _views(use: Any, names: oiio.ColorConfig) -> Sequence[str]:
    """Views of the display, or all displays if it is unknown."""
    displays = {name.lower(): name for name in names.getDisplayNames()} | {"default": names.getDefaultDisplayName()}
    own = displays.get(use.display.lower())
    return names.getViewNames(own) if own else names.getDisplayNames()


COLOR = (
    IsColorSpace,
    ToColorSpace,
    ColorConvert,
    ColorMatrix,
    op("ociolook", "Apply one or more OCIO looks.", OnColor,
       known=lambda use, names: names.getLookNames(),
       convert=lambda use, color, config: oiio.ImageBufAlgo.ociolook(
           color, use.look, _space(use.from_, color.spec()), _space(use.to, color.spec()),
           use.unpremult, use.inverse, use.key, use.value, config),
       look=(str, argument(help="Name of a look, or a comma-separated list of looks.", example="night")),
       from_=param("current", help="Color space of the input. current: the image's color space tag.", example="ACEScg"),
       to=param("current", help="Color space of the result. current: the image's color space tag.", example="ACEScg"),
       inverse=param(False, help="Apply the inverse look."),
       key=_KEY,
       value=_VALUE),
    op("ociodisplay", "Apply an OCIO display and view.", OnColor,
       known=_views,
       convert=lambda use, color, config: oiio.ImageBufAlgo.ociodisplay(
           color, use.display, use.view, _end_of_view(use, color.spec()), use.looks,
           use.unpremult, use.inverse, use.key, use.value, config),
       display=(str, argument(help="Name of the display, or `default` for that of the config.", example="default")),
       view=(str, argument(help="Name of the view, or `default` for that of the display.", example="default")),
       from_=param("current", example="ACEScg",
                   help="Color space of the input, or with inverse of the result. current: the image's tag."),
       looks=param("", help="Comma-separated looks that replace those of the view.", example="night"),
       inverse=param(False, help="Convert from the display and view back to the color space."),
       key=_KEY,
       value=_VALUE),
    FileTransform,
    op("ocionamedtransform", "Apply an OCIO named transform.", OnColor,
       known=lambda use, names: names.getNamedTransformNames(),
       convert=lambda use, color, config: oiio.ImageBufAlgo.ocionamedtransform(
           color, use.transform, use.unpremult, use.inverse, use.key, use.value, config),
       transform=(str, argument(help="Name of the transform.", example="grade")),
       inverse=param(False, help="Apply the inverse transform."),
       key=_KEY,
       value=_VALUE),
)  # fmt: skip
