# SPDX-License-Identifier: Apache-2.0
"""--tev: an image shown in tev, band by band while it is made."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

from ...color.config import as_float
from ...core.demand import bands, cached, stream
from ...core.image import Image, Part
from ...core.parameters import param
from ...deferred import np
from ...errors import Error
from ...host.color import ToColorSpace
from ..language.parse import Option
from ..stack.chain import Chain

if TYPE_CHECKING:
    from tevclient import Ipc

_SPACE = "lin_rec709"
_BAND = 1 << 20  # bytes sent at once: what is seen grows


@dataclass(frozen=True)
class ViewModifiers:
    """Of --tev."""

    host: str = param("127.0.0.1", help="the machine on which tev runs")
    port: int = param(14158, ge=1, le=65535, help="where it listens")
    name: str = param("", help="what it is called there; the image's own name when left out")


def show(chain: Chain, given: ViewModifiers) -> None:
    """Show the top image in the viewer tev while it is made."""
    with _tev(given) as viewer:
        if not chain.acts(*chain.top.parts):  # somebody listens, that is all there is to see now
            return
        cache = chain.session.resources.cache  # they will be written as well
        parts = tuple(cached(part, cache) for part in chain.top.parts)
        image = chain.stack[-1] = Image(parts, chain.top.source)
        name = given.name or image.source or "oiiotex"
        for part in _linear(chain, image).parts:
            _send(chain, viewer, name if len(parts) == 1 else f"{name} {part.name}", part)


def _linear(chain: Chain, image: Image) -> Image:
    """As tev takes colors, in linear Rec. 709, where the image says what its own are."""
    tag = image.first.spec.get_string_attribute("oiio:ColorSpace")
    if not tag or chain.session.resources.color.is_data(tag):
        return image
    return ToColorSpace(source=image, to_space=_SPACE, strict=False).compute(chain.session)


def _send(chain: Chain, viewer: Ipc, title: str, part: Part) -> None:
    spec, window = part.spec, part.window
    channels = [name.rsplit(".", 1)[-1] for name in spec.channelnames]
    viewer.create_image(title, window.width, window.height, channels)
    for band, pixels in stream(part, bands(part, _BAND)):
        values = as_float(pixels) if pixels.dtype in (np.uint8, np.uint16) else pixels.astype(np.float32)
        viewer.update_image(title, values, channels, band.left - window.left, band.top - window.top)
        chain.session.progress.advance(band.bottom - window.top, window.height)


@contextlib.contextmanager
def _tev(given: ViewModifiers) -> Iterator[Ipc]:
    try:
        from tevclient import Ipc
    except ImportError as error:
        raise Error("--tev: tevclient is not installed: pip install oiiotex[tev]") from error
    try:
        with Ipc(given.host, given.port) as viewer:
            yield viewer
    except OSError as error:
        text = error.strerror or str(error)
        raise Error(f"--tev: no tev listens at {given.host}:{given.port} ({text}): start it first") from error


OPTIONS = (Option("--tev", show, ViewModifiers, needs=1, flat=True),)
