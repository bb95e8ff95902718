# SPDX-License-Identifier: Apache-2.0
"""Compositing of flat and of deep images, and colors by alpha."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

from ..core.image import Image, Part
from ..core.op import Op
from ..core.parameters import image, param
from ..deferred import oiio
from ..session import Session
from .arithmetic import OneImage, TwoImages
from .kinds import AtOnce, worked

log = logging.getLogger("oiiotex")


def warn_of_second_unpremult(spec: oiio.ImageSpec) -> None:
    """Say so where colours that have been divided by alpha are to be divided again."""
    if spec.get_int_attribute("oiio:UnassociatedAlpha") and spec.alpha_channel >= 0:
        log.warning("the image says that its colours are not multiplied by alpha, and they are divided by it once more")


@dataclass(frozen=True, kw_only=True)
class Over(TwoImages):
    """Put the first image over the second, by its alpha."""

    name: ClassVar[str] = "over"
    function = "over"


@dataclass(frozen=True, kw_only=True)
class DepthOver(TwoImages):
    """Put that one of two images over the other that is nearer, by channel Z."""

    name: ClassVar[str] = "zover"

    zeroisinf: bool = param(False, help="depth 0 means infinitely far")

    def apply(self, *buffers: oiio.ImageBuf) -> oiio.ImageBuf:
        """The nearer over the farther."""
        return oiio.ImageBufAlgo.zover(buffers[0], buffers[1], self.zeroisinf)


@dataclass(frozen=True, kw_only=True)
class ByAlpha(OneImage):
    """Colour by alpha."""

    def result(self, parts: Sequence[Part], session: Session) -> Part:
        """The result, not yet computed; where there is no alpha, what there is: OpenImageIO would move its pixels."""
        return super().result(parts, session) if parts[0].spec.alpha_channel >= 0 else worked(parts[0])


@dataclass(frozen=True, kw_only=True)
class Premultiply(ByAlpha):
    """Multiply the colour by alpha."""

    name: ClassVar[str] = "premult"
    function = "premult"


@dataclass(frozen=True, kw_only=True)
class Unpremultiply(ByAlpha):
    """Divide the colour by alpha."""

    name: ClassVar[str] = "unpremult"
    function = "unpremult"

    def result(self, parts: Sequence[Part], session: Session) -> Part:
        """The result, not yet computed."""
        warn_of_second_unpremult(parts[0].spec)
        return super().result(parts, session)


@dataclass(frozen=True, kw_only=True)
class Repremultiply(ByAlpha):
    """Multiply the colour by alpha, but leave it where alpha is 0."""

    name: ClassVar[str] = "repremult"
    function = "repremult"


# --- deep images: pixels of any number of samples, each with a depth; OpenImageIO holds them whole ---


@dataclass(frozen=True, kw_only=True)
class DeepOp(AtOnce):
    """An op of deep images, through the function of ImageBufAlgo."""

    deep: ClassVar[bool] = True

    def extra(self) -> tuple[Any, ...]:
        """What the function takes after the images."""
        return ()

    def apply(self, *buffers: oiio.ImageBuf) -> oiio.ImageBuf:
        """The result from whole images."""
        return self.of_buffers(*buffers, *self.extra())


@dataclass(frozen=True, kw_only=True)
class Deepen(DeepOp):
    """Turn a flat image into a deep one, with a sample in each pixel that is not empty."""

    name: ClassVar[str] = "deepen"
    function: ClassVar[str] = "deepen"

    source: Image = image(help="the image")
    z: float = param(1.0, help="depth of the samples of an image without channel Z")

    def extra(self) -> tuple[Any, ...]:
        """The depth."""
        return (self.z,)


@dataclass(frozen=True, kw_only=True)
class Flatten(DeepOp):
    """Composite the samples of each pixel of a deep image into a flat image."""

    name: ClassVar[str] = "flatten"
    function: ClassVar[str] = "flatten"

    source: Image = image(help="the deep image")


@dataclass(frozen=True, kw_only=True)
class _TwoDeep(DeepOp):
    """Two deep images."""

    a: Image = image(help="the first deep image")
    b: Image = image(help="the second deep image")


@dataclass(frozen=True, kw_only=True)
class DeepMerge(_TwoDeep):
    """Merge the samples of two deep images; samples behind an opaque one are removed."""

    name: ClassVar[str] = "deepmerge"
    function: ClassVar[str] = "deep_merge"


@dataclass(frozen=True, kw_only=True)
class DeepHoldout(_TwoDeep):
    """Remove the samples of the first deep image that lie behind an opaque sample of the second."""

    name: ClassVar[str] = "deepholdout"
    function: ClassVar[str] = "deep_holdout"


OPS: tuple[type[Op], ...] = (
    Over,
    DepthOver,
    Premultiply,
    Unpremultiply,
    Repremultiply,
    Deepen,
    Flatten,
    DeepMerge,
    DeepHoldout,
)
