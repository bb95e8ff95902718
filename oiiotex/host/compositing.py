# SPDX-License-Identifier: Apache-2.0
"""Compositing, and colours by alpha."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

from ..core.image import Part
from ..core.op import Op
from ..core.parameters import param
from ..deferred import oiio
from ..session import Session
from .arithmetic import OneImage, TwoImages
from .kinds import worked

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
        return oiio.ImageBufAlgo.zover(*buffers, self.zeroisinf)


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


OPS: tuple[type[Op], ...] = (Over, DepthOver, Premultiply, Unpremultiply, Repremultiply)
