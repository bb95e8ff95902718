# SPDX-License-Identifier: Apache-2.0
"""--tev: show an image in tev, band by band while it is computed."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

from ....engine.color.config import as_float
from ....engine.core.demand import bands, cached, stream
from ....engine.core.image import Image, Part
from ....engine.core.parameters import param
from ....engine.deferred import np
from ....engine.errors import Error, reason_of
from ...host.color import ToColorSpace
from ..language.parse import Option
from ..stack.chain import Chain

if TYPE_CHECKING:
    from tevclient import Ipc

_SPACE = "lin_rec709"
_BAND = 1 << 20  # bytes per message


@dataclass(frozen=True)
class ViewModifiers:
    """Modifiers of --tev."""

    host: str = param("127.0.0.1", example="workstation", help="Host on which tev runs.")
    port: int = param(14158, ge=1, le=65535, help="TCP port of tev.")
    name: str = param("", unset="that of the image", example="tile", help="Name of the image in tev.")


def show(chain: Chain, given: ViewModifiers) -> None:
    """Show the top image in the viewer tev while it is computed."""
    with _tev(given) as viewer:
        if not chain.acts(*chain.top.parts):  # tev answers: the rehearsal checks no more
            return
        cache = chain.session.resources.cache  # later outputs reuse the pixels
        parts = tuple(cached(part, cache) for part in chain.top.parts)
        image = chain.stack[-1] = Image(parts, chain.top.source)
        name = given.name or image.source or "oiiotex"
        for part in _linear(chain, image).parts:
            _send(chain, viewer, name if len(parts) == 1 else f"{name} {part.name}", part)


def _linear(chain: Chain, image: Image) -> Image:
    """The image in tev's linear Rec. 709, if its color space is known."""
    image = chain.session.resources.color.believed(image)
    tag = image.first.spec.get_string_attribute("oiio:ColorSpace")
    if not tag or chain.session.resources.color.is_data(tag):
        return image
    return ToColorSpace(source=image, to_space=_SPACE, strict=False).plan(chain.session.resources).results


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
        raise Error("--tev requires tevclient: pip install oiiotex[tev]") from error
    try:
        with Ipc(given.host, given.port) as viewer:
            yield viewer
    except OSError as error:
        text = error.strerror or reason_of(error)
        raise Error(f"--tev: no tev at {given.host}:{given.port} ({text}): start tev first") from error


OPTIONS = (Option("--tev", show, ViewModifiers, needs=1, flat=True),)
