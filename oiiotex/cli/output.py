# SPDX-License-Identifier: Apache-2.0
"""Options that write images, and those that say how."""

from __future__ import annotations

import logging
import os

import OpenImageIO as oiio

from ..errors import ParameterError
from ..images import type_named
from ..writing import Format, write
from .chain import Chain
from .parse import Option

log = logging.getLogger("oiiotex")


def write_output(chain: Chain, path: str) -> None:
    """Write the top image."""
    if os.path.realpath(path) in chain.session.written:
        raise ParameterError(f"{path} has just been written by an op's modifier")
    with chain.session.stats.time("write"):
        write(chain.top, path, _format(chain), chain.session.advance)
    log.info("wrote %s", path)
    chain.unwritten, chain.used = False, True


def _format(chain: Chain) -> Format:
    return Format(
        pixel_type=chain.settings.get("-d"),
        computed_type=chain.first.pixel_type,
        computed_channels=chain.first.channel_types,
        tile=chain.settings.get("--tile"),
    )


def set_type(chain: Chain, text: str) -> None:
    """The pixel type of what is written from here on."""
    chain.settings["-d"] = type_named(text)


OPTIONS = (
    Option("-o", ("FILE",), "write the top image; a run that fails leaves the old file as it was", write_output, needs=1),
    Option("-d", ("TYPE",), "pixel type of what is written from here on: uint8, half, float ...", set_type, state=True),
)
_ = oiio
