# SPDX-License-Identifier: Apache-2.0
"""By what pixels are known again."""

from __future__ import annotations

import hashlib

from ..deferred import np, oiio
from ..errors import ImageError
from .demand import bands, stream
from .image import Part, dtype_of


def sha1(part: Part) -> str:
    """The SHA-1 of a part's pixels, each channel in its own type.

    Raises
    ------
    ImageError
        Whole numbers lie beside broken ones: they are not read exactly.
    """
    kinds = [_numpy_type(part.spec.channelformat(channel)) for channel in range(part.spec.nchannels)]
    own = np.dtype(dtype_of(part.spec))
    if any(kind.kind != own.kind for kind in kinds):
        raise ImageError(f"'{part.name}' has channels of whole and of broken numbers: no hash can be made")
    packed = np.dtype([(str(channel), kind) for channel, kind in enumerate(kinds)])
    digest = hashlib.sha1(usedforsecurity=False)
    for _, pixels in stream(part, bands(part)):
        if any(kind != own for kind in kinds):
            mixed = np.empty(pixels.shape[:2], packed)
            for channel in range(len(kinds)):
                mixed[str(channel)] = pixels[..., channel]
            pixels = mixed
        digest.update(np.ascontiguousarray(pixels).data)
    return digest.hexdigest().upper()


def _numpy_type(kind: oiio.TypeDesc) -> np.dtype:
    return np.dtype(dtype_of(oiio.ImageSpec(1, 1, 1, kind)))
