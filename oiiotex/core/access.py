# SPDX-License-Identifier: Apache-2.0
"""How an op looks at pixels. An op is of one of these kinds, by its base class, and never says more of it itself.

What help says follows from the kind, and so do the promises that tests hold every op to: which pixels may be asked for
before a window of the result is, and which ones then (tests/test_promises.py, tests/test_streaming.py).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar

from ..deferred import np, oiio
from .demand import PIECE_PIXELS, cached
from .image import Part, derived_spec
from .op import Op
from .window import Window

if TYPE_CHECKING:
    from ..session import Session
    from ..session.resources import Resources


@dataclass(frozen=True, kw_only=True)
class _Mapped(Op):
    """What makes its result from pixels at their place."""

    def halo(self) -> tuple[int, int]:
        """How many pixels it looks to each side: (x, y)."""
        return 0, 0

    def mapped(
        self,
        part: Part,
        work: Callable[[np.ndarray, Window], np.ndarray],
        session: Session,
        spec: oiio.ImageSpec | None = None,
    ) -> Part:
        """A part of the same size, window by window, computed on all threads when it is asked for.

        `work`: (pixels of the part, window) -> pixels of the result there. It must give a pixel the same value in any
        window. With a halo the pixels are those of the window grown by it, as far as the part goes.
        """
        return mapped(part, work, session.resources, spec, self.halo())


def mapped(
    part: Part,
    work: Callable[[np.ndarray, Window], np.ndarray],
    resources: Resources,
    spec: oiio.ImageSpec | None = None,
    halo: tuple[int, int] = (0, 0),
) -> Part:
    """As `_Mapped.mapped`, for any op; `halo` is how many pixels `work` needs to each side, (x, y)."""
    whole, source = part.window, cached(part, resources.cache) if any(halo) else part

    def fetch(window: Window) -> np.ndarray:
        around = window.grown(*halo) & whole
        rows = source.read(around)
        pieces = list(window.cells(window.width, max(1, PIECE_PIXELS // max(1, window.width))))
        if len(pieces) == 1:
            return work(rows, window)
        seen = {piece: rows[(piece.grown(*halo) & whole).inside(around)] for piece in pieces}
        return np.concatenate(list(resources.spread(lambda piece: work(seen[piece], piece), pieces)))

    return replace(part, spec=spec or derived_spec(part.spec), fetch=fetch, levels=(), ready=False)


@dataclass(frozen=True, kw_only=True)
class Pointwise(_Mapped):
    """A pixel of the result follows from the pixels at its place."""

    reach: ClassVar[str] = "looks at one pixel, and streams"


@dataclass(frozen=True, kw_only=True)
class Neighborhood(_Mapped):
    """A pixel of the result follows from those around its place, as far as `halo` says."""

    reach: ClassVar[str] = "looks at a neighborhood, and streams"

    def halo(self) -> tuple[int, int]:
        """How many pixels it looks to each side: (x, y)."""
        raise NotImplementedError


@dataclass(frozen=True, kw_only=True)
class ScanThenMap(_Mapped):
    """It looks through its images band by band and keeps what it sums up; then it is as what is pointwise."""

    scans: ClassVar[bool] = True
    reach: ClassVar[str] = "looks through the whole image in bands, then at one pixel, and streams"


@dataclass(frozen=True, kw_only=True)
class Gather(Op):
    """A pixel of the result follows from pixels elsewhere: nothing is held for the result, its source may be."""

    reach: ClassVar[str] = "looks at pixels anywhere; the result streams"


@dataclass(frozen=True, kw_only=True)
class AnyWindow(Op):
    """Any window of the result is made alone, of no image or of small ones that are read before."""

    reach: ClassVar[str] = "makes any window alone"


@dataclass(frozen=True, kw_only=True)
class Whole(Op):
    """It holds its images and its result, and says before it starts how much that needs."""

    scans: ClassVar[bool] = True
    reach: ClassVar[str] = "holds the whole image"


@dataclass(frozen=True, kw_only=True)
class InBands(Op):
    """It looks at its images and makes its result over and over, in bands of rows; beyond the budget they lie in files.

    Masks and maps of weights are held, and what still does not fit says before it starts how much it needs.
    """

    scans: ClassVar[bool] = True
    reach: ClassVar[str] = "passes through its exemplar and its result in bands, from memory or from files"
