# SPDX-License-Identifier: Apache-2.0
"""Color management, by OpenColorIO inside OpenImageIO."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

from ..core.access import Pointwise
from ..core.attributes import TAG
from ..core.image import Image, Part, channels_of
from ..core.parameters import Numbers, argument, image, param
from ..deferred import np, oiio
from ..errors import ColorError, ImageError, ParameterError
from ..io.documents import require_regular
from ..session import Session
from .kinds import HostOp, Respec, checked, op, pointwise, worked

log = logging.getLogger("oiiotex")

_KEY = param("", help="names of OCIO context variables, with commas")
_VALUE = param("", help="their values, with commas")


@dataclass(frozen=True, kw_only=True)
class IsColorSpace(Respec):
    """Say in which color space the pixels are; they stay as they are."""

    name: ClassVar[str] = "iscolorspace"

    space: str = argument(  # type: ignore[misc, assignment]  # a user's word, where others declare where they work
        help="a color space, role or alias of the config; '' to forget it"
    )

    def called(self, spec: oiio.ImageSpec) -> None:
        """Set it, and forget what contradicts it."""
        spec.set_colorspace(self.space)

    def result(self, parts: Sequence[Part], session: Session) -> Part:
        """The part under its new spec."""
        if not self.space:
            return super().result(parts, session)
        session.resources.color.resolve(self.space)
        known = replace(self, space=session.resources.color.known_name(self.space))
        return super(IsColorSpace, known).result(parts, session)


@dataclass(frozen=True, kw_only=True)
class OnColor(HostOp, Pointwise):
    """Works on color alone: on R, G, B (by name, else the first three) and alpha; further channels are copied."""

    source: Image = image(help="the image")
    unpremult: bool = param(False, help="convert colors divided by alpha, and multiply them again")

    def convert(self, color: oiio.ImageBuf, config: str) -> oiio.ImageBuf:
        """The conversion of up to four channels; `config` is the path of the color config."""
        raise NotImplementedError

    def known(self, names: oiio.ColorConfig) -> Sequence[str]:
        """What the config has of the kind that is asked for, to be told where it cannot be converted."""
        return ()

    def result(self, parts: Sequence[Part], session: Session) -> Part:
        """The result, not yet computed; that the conversion exists is found out now."""
        path = session.resources.color.path

        def convert(color: oiio.ImageBuf) -> oiio.ImageBuf:
            try:
                return checked(self.convert(color, path))
            except (ImageError, RuntimeError) as error:  # OpenImageIO may take braces in names for its own
                known = ", ".join(self.known(session.resources.color.names))
                raise ColorError(f"{error} ({path}{f' has {known}' if known else ''})") from None

        return pointwise(parts, parts[0].window, lambda source: _converted(source, convert))


def _converted(source: oiio.ImageBuf, convert: Callable[[oiio.ImageBuf], oiio.ImageBuf]) -> oiio.ImageBuf:
    """The image with its color converted: OpenImageIO's functions spoil what comes behind the fourth channel."""
    spec, channels = source.spec(), channels_of(source.spec())
    color, alpha = tuple(channels.color), () if channels.alpha is None else (channels.alpha,)
    if (*color, *alpha) == tuple(range(spec.nchannels)) and (not alpha or len(color) == 3):
        return convert(source)
    three = color * 3 if len(color) == 1 else (*color, 0.0)[:3]
    narrow = oiio.ImageBufAlgo.channels(source, (*three, *alpha), ("R", "G", "B", "A")[: 3 + len(alpha)])
    both = oiio.ImageBufAlgo.channel_append(checked(convert(narrow)), source)
    places = dict(zip(color, range(3), strict=False)) | dict.fromkeys(alpha, 3)  # of what was converted
    order = tuple(places.get(n, narrow.nchannels + n) for n in range(spec.nchannels))
    return oiio.ImageBufAlgo.channels(both, order, spec.channelnames)


def _space(given: str, spec: oiio.ImageSpec) -> str:
    """A color space as the user names it; 'current' is what the image says, which is not guessed where it does not."""
    if given not in ("", "current"):
        return given
    tag = spec.get_string_attribute(TAG)
    if not tag:
        raise ColorError("the image does not say its color space: put --iscolorspace NAME before it")
    return tag


# --- between color spaces ---


@dataclass(frozen=True, kw_only=True)
class Converting(OnColor):
    """What conversions between spaces share."""

    key: str = _KEY
    value: str = _VALUE
    strict: bool = param(True, help="refuse what cannot be converted; else it stays as it is, with a warning")

    def spaces(self) -> dict[str, str]:
        """From, to."""
        return {name: getattr(self, name, "current") for name in ("from_space", "to_space")}

    def convert(self, color: oiio.ImageBuf, config: str) -> oiio.ImageBuf:
        """In the other space."""
        source, target = self.spaces().values()
        source = _space(source, color.spec())
        return oiio.ImageBufAlgo.colorconvert(color, source, target, self.unpremult, self.key, self.value, config)

    def result(self, parts: Sequence[Part], session: Session) -> Part:
        """The result, not yet computed."""
        names: dict[str, Any] = {
            n: session.resources.color.known_name(s) for n, s in self.spaces().items() if hasattr(self, n)
        }
        try:
            return super(Converting, replace(self, **names)).result(parts, session)
        except ColorError as error:
            if self.strict:
                for name in {*self.spaces().values()} - {"", "current"}:
                    session.resources.color.resolve(name)  # it says more
                raise
            log.warning("%s: %s; the image stays as it is", self.flag(), error)
            return worked(parts[0])


@dataclass(frozen=True, kw_only=True)
class ColorConvert(Converting):
    """Convert from a color space to another."""

    name: ClassVar[str] = "colorconvert"

    from_space: str = argument(help="a color space, role or alias of the config; current: the one that the image says")
    to_space: str = argument(help="a color space, role or alias")

    def idle(self, parts: Sequence[Part]) -> bool:
        """Whether both are the same."""
        return self.from_space == self.to_space


@dataclass(frozen=True, kw_only=True)
class ToColorSpace(Converting):
    """Convert to a color space from the one that the image says."""

    name: ClassVar[str] = "tocolorspace"

    to_space: str = argument(help="a color space, role or alias of the config")


# --- other transforms ---


@dataclass(frozen=True, kw_only=True)
class ColorMatrix(OnColor):
    """Multiply colors, as row vectors, by a matrix."""

    name: ClassVar[str] = "ccmatrix"

    matrix: Numbers = argument(help="9 or 16 numbers, row by row")
    transpose: bool = param(False, help="transpose it first")
    invert: bool = param(False, help="invert it then")
    inverse: bool = param(False, help="the same")

    def __post_init__(self) -> None:
        super().__post_init__()
        self._matrix()

    def _matrix(self) -> np.ndarray:
        """(4, 4) float64."""
        size = {9: 3, 16: 4}.get(len(self.matrix))
        if size is None:
            raise ParameterError(f"matrix={self.matrix}: allowed are 9 or 16 numbers with commas between them")
        matrix: np.ndarray = np.eye(4)
        matrix[:size, :size] = np.reshape(self.matrix, (size, size))
        if self.transpose:
            matrix = matrix.T
        if self.invert or self.inverse:
            try:
                matrix = np.linalg.inv(matrix)
            except np.linalg.LinAlgError:
                raise ParameterError(f"matrix={self.matrix}: it has no inverse") from None
        return matrix

    def convert(self, color: oiio.ImageBuf, config: str) -> oiio.ImageBuf:
        """Multiplied."""
        return oiio.ImageBufAlgo.colormatrixtransform(color, tuple(self._matrix().ravel()), self.unpremult)


@dataclass(frozen=True, kw_only=True)
class FileTransform(OnColor):
    """Apply a transform that is a file: a LUT, CLF, CDL."""

    name: ClassVar[str] = "ociofiletransform"

    file: str = argument(help="the file, where it lies or in the config's search path")
    inverse: bool = param(False, help="undo it")

    def __post_init__(self) -> None:
        super().__post_init__()
        require_regular(self.file)

    def convert(self, color: oiio.ImageBuf, config: str) -> oiio.ImageBuf:
        """Transformed."""
        return oiio.ImageBufAlgo.ociofiletransform(color, self.file, self.unpremult, self.inverse, config)


def _views(use: Any, names: oiio.ColorConfig) -> Sequence[str]:
    """Views of the display, or displays."""
    displays = {name.lower(): name for name in names.getDisplayNames()} | {"default": names.getDefaultDisplayName()}
    own = displays.get(use.display.lower())
    return names.getViewNames(own) if own else names.getDisplayNames()


COLOR = (
    IsColorSpace,
    ToColorSpace,
    ColorConvert,
    ColorMatrix,
    op("ociolook", "Apply looks of the config.", OnColor,
       known=lambda use, names: names.getLookNames(),
       convert=lambda use, color, config: oiio.ImageBufAlgo.ociolook(
           color, use.look, _space(use.from_, color.spec()), _space(use.to, color.spec()),
           use.unpremult, use.inverse, use.key, use.value, config),
       look=(str, argument(help="name of the look, or several with commas")),
       from_=param("current", help="the image's color space"),
       to=param("current", help="that of the result"),
       inverse=param(False, help="undo the look"),
       key=_KEY,
       value=_VALUE),
    op("ociodisplay", "Convert for a display and view of the config.", OnColor,
       known=_views,
       convert=lambda use, color, config: oiio.ImageBufAlgo.ociodisplay(
           color, use.display, use.view, _space(use.from_, color.spec()), use.looks,
           use.unpremult, use.inverse, use.key, use.value, config),
       display=(str, argument(help="name of the display, or default")),
       view=(str, argument(help="name of the view, or default")),
       from_=param("current", help="the image's color space; of the result, with inverse"),
       looks=param("", help="looks to apply instead of the view's"),
       inverse=param(False, help="from the display back"),
       key=_KEY,
       value=_VALUE),
    FileTransform,
    op("ocionamedtransform", "Apply a named transform of the config.", OnColor,
       known=lambda use, names: names.getNamedTransformNames(),
       convert=lambda use, color, config: oiio.ImageBufAlgo.ocionamedtransform(
           color, use.transform, use.unpremult, use.inverse, use.key, use.value, config),
       transform=(str, argument(help="its name")),
       inverse=param(False, help="undo it"),
       key=_KEY,
       value=_VALUE),
)  # fmt: skip
