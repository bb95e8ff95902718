# SPDX-License-Identifier: Apache-2.0
"""Access kinds: which pixels of its images an op reads. The base class of an op determines its kind.

The line in the help follows from the kind, and so do the guarantees that tests check: which pixels may be read before
and during the computation of a window of the result (tests/promises/).
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
    """An op whose result at a pixel depends on the source near that pixel."""

    def halo(self) -> tuple[int, int]:
        """Number of pixels that it reads on each side: (x, y)."""
        return 0, 0

    def mapped(
        self,
        part: Part,
        work: Callable[[np.ndarray, Window], np.ndarray],
        session: Session,
        spec: oiio.ImageSpec | None = None,
    ) -> Part:
        """A part of the same size, computed window by window, on all threads, when it is read.

        `work`: (pixels of the part, window) -> pixels of the result there. The value of a pixel must not depend on the
        window. With a halo, the pixels are those of the window grown by it and clipped to the part.
        """
        return mapped(part, work, session.resources, spec, self.halo())


def mapped(
    part: Part,
    work: Callable[[np.ndarray, Window], np.ndarray],
    resources: Resources,
    spec: oiio.ImageSpec | None = None,
    halo: tuple[int, int] = (0, 0),
) -> Part:
    """As `_Mapped.mapped`, for any op; `halo`: number of pixels that `work` needs on each side, (x, y)."""
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
    """A pixel of the result depends on the source pixel at the same place."""

    reach: ClassVar[str] = "pointwise, out-of-core"


@dataclass(frozen=True, kw_only=True)
class Neighborhood(_Mapped):
    """A pixel of the result depends on source pixels within `halo` of its place."""

    reach: ClassVar[str] = "neighborhood, out-of-core"

    def halo(self) -> tuple[int, int]:
        """Number of pixels that it reads on each side: (x, y)."""
        raise NotImplementedError


@dataclass(frozen=True, kw_only=True)
class ScanThenMap(_Mapped):
    """It scans its images in bands for statistics, then computes its result pointwise."""

    scans: ClassVar[bool] = True
    reach: ClassVar[str] = "two-pass (a scan of the whole image, then pointwise), out-of-core"


@dataclass(frozen=True, kw_only=True)
class Gather(Op):
    """A pixel of the result depends on source pixels anywhere: the source may be held, the result is not."""

    reach: ClassVar[str] = "gather (reads source pixels anywhere), with an out-of-core result"


@dataclass(frozen=True, kw_only=True)
class AnyWindow(Op):
    """Any window of the result is computed alone, from no image or from small ones that are read first."""

    reach: ClassVar[str] = "computes any window alone"


@dataclass(frozen=True, kw_only=True)
class Whole(Op):
    """It holds its images and its result, and checks the memory budget before it starts."""

    scans: ClassVar[bool] = True
    reach: ClassVar[str] = "whole-image, in memory"


@dataclass(frozen=True, kw_only=True)
class InBands(Op):
    """It reads its images and updates its result repeatedly, in bands of rows, from files if the budget is exceeded.

    Masks and weights are held in memory. The remaining memory is checked before the work starts.
    """

    scans: ClassVar[bool] = True
    reach: ClassVar[str] = "iterative, out-of-core beyond the memory budget"
