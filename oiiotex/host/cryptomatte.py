# SPDX-License-Identifier: Apache-2.0
"""Cryptomatte."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import ClassVar

from ..core.image import Image, pixels_of
from ..core.op import Op
from ..core.parameters import argument, image
from ..deferred import np, oiio
from ..errors import ParameterError
from .kinds import PointOp


@dataclass(frozen=True, kw_only=True)
class CryptomatteColors(PointOp):
    """Show the ids of a Cryptomatte layer as colours."""

    name: ClassVar[str] = "cryptomatte-colors"

    source: Image = image(help="the image")
    layer: str = argument(help="name of the layer: its channels are NAME00.R and so on")

    def apply(self, *buffers: oiio.ImageBuf) -> oiio.ImageBuf:
        """A colour for each id, by its coverage."""
        (source,) = buffers
        pattern = re.compile(re.escape(self.layer) + r"\d\d\..*", re.ASCII)
        names = source.spec().channelnames
        ranks = [n for n, name in enumerate(names) if pattern.fullmatch(name)]
        if not ranks:
            raise ParameterError(
                f"layer={self.layer}: the image has no channels {self.layer}00.R ...; it has {', '.join(names)}"
            )
        values = pixels_of(source, oiio.FLOAT)
        colour = np.zeros((*values.shape[:-1], 3), np.float32)
        for identity, coverage in zip(ranks[::2], ranks[1::2], strict=False):
            code, alpha = np.ascontiguousarray(values[..., identity]), values[..., coverage]
            seen = ~(alpha < 1.0e-5) & (code != 0)
            scrambled = _scrambled(code.view(np.uint32))
            for channel, salt in enumerate((0, 0x0101, 0x020000)):
                scrambled = _scrambled(scrambled + np.uint32(salt)) if channel else scrambled
                shade = scrambled.astype(np.float32) * np.float32(1.0 / 0xFFFFFFFF)
                colour[..., channel] += np.where(seen, alpha * shade, np.float32(0))
        spec = oiio.ImageSpec(source.spec())
        spec.nchannels = 3
        spec.channelnames = ("R", "G", "B")
        spec.alpha_channel = spec.z_channel = -1
        result = oiio.ImageBuf(spec)
        result.set_pixels(result.roi, colour)
        return result


def _scrambled(code: np.ndarray) -> np.ndarray:
    """uint32 -> uint32: the finishing step of MurmurHash3, in which every bit depends on every other."""
    code = (code ^ (code >> np.uint32(16))) * np.uint32(0x85EBCA6B)
    code = (code ^ (code >> np.uint32(13))) * np.uint32(0xC2B2AE35)
    return code ^ (code >> np.uint32(16))


OPS: tuple[type[Op], ...] = (CryptomatteColors,)
