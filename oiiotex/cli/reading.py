# SPDX-License-Identifier: Apache-2.0
"""Options that read images."""

from __future__ import annotations

import logging

from ..files import read
from .chain import Chain
from .parse import Option

log = logging.getLogger("oiiotex")


def read_input(chain: Chain, path: str) -> None:
    """Put an image file, or the image of that label, on the stack."""
    if path in chain.labelled:
        chain.push(chain.labelled[path])
        return
    log.info("read %s", path)
    image = read(path, chain.session.cache, native=bool(chain.settings.get("--native")))
    chain.first.learn(image)
    chain.push(image)


def native(chain: Chain) -> None:
    """What is read keeps its pixel type."""
    chain.settings["--native"] = True


OPTIONS = (
    Option("-i", ("FILE",), "read an image (as naming it does) and put it on the stack", read_input),
    Option("--native", (), "ops work on the pixel type of the file instead of float", native, state=True),
)
