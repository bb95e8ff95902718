# SPDX-License-Identifier: Apache-2.0
"""What expressions ask of the image stack."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from ...core.image import Image

if TYPE_CHECKING:
    from ..printing.pixel_statistics import Statistics
    from .chain import Chain


class ChainAccess:
    """An `expressions.ImageAccess` of a chain."""

    def __init__(self, chain: Chain):
        self._chain = chain

    def depth(self) -> int:
        """How many images the stack holds."""
        return len(self._chain.stack)

    def image(self, index: int) -> Image:
        """The image at that depth, 0 the top."""
        return self._chain.image(index)

    def read(self, path: str) -> Image:
        """The image of a file."""
        return self._chain.opened(path)

    def labels(self) -> Mapping[str, Image]:
        """The images of --label."""
        return self._chain.labelled

    def variables(self) -> Mapping[str, int | float | str]:
        """What --set and --for have set."""
        return self._chain.user

    def frame_number(self) -> int | None:
        """The frame of the sequence that is worked on."""
        return self._chain.frame.number if self._chain.frame else None

    def frame_padding(self) -> int:
        """Digits of --framepadding."""
        return self._chain.frame.padding if self._chain.frame else 0

    def pixel_type(self, image: Image, native: bool) -> str:
        """The type of the image's pixels, in its file or for ops."""
        return str(image.first.spec.format if native else image.first.working_type)

    def statistics(self, image: Image) -> Statistics:
        """Smallest, largest and mean values of the first part's channels."""
        from ..printing.pixel_statistics import statistics

        return statistics(image)

    def constant_colour(self, image: Image) -> Sequence[float] | None:
        """The colour of an image that has only one."""
        from ..printing.pixel_statistics import constant_colour

        return constant_colour(image)

    def metadata_text(self, image: Image, verbose: bool, native: bool) -> str:
        """What --info prints."""
        from ..printing.metadata import metadata_text

        return metadata_text(image, verbose, native)

    def statistics_text(self, image: Image) -> str:
        """What --stats prints."""
        from ..printing.pixel_statistics import statistics_text

        return statistics_text(image)
