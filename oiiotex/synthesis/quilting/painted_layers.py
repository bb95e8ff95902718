# SPDX-License-Identifier: Apache-2.0
"""The layers of a label painting (LSA16 section 6.2): a coarse one, overlaid by a fine one where it is painted.

Each layer is quilted by itself, and the fine one is joined to the coarse one along minimum-error seams.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from ...engine.core.demand import MadeRows, SomeRows
from ...engine.core.image import Image, Part
from ...engine.core.label_map import LabelMap
from ...engine.core.parameters import Size
from ...engine.core.source_map import SourceMap
from ...engine.core.window import Window
from ...engine.deferred import np, oiio
from ...engine.session.progress import Progress
from ...engine.session.resources import Resources
from ..exemplar.exemplar_op import ExemplarPixels
from ..graphcut.seam_overlay import TILE, SeamOverlay
from .guide_map import Meaning, Table, meaning_of
from .label_painting import painted_labels, read_begun
from .quilt_job import Quilted, Sewing
from .quilter import Quilt


@dataclass(frozen=True)
class LayeredPainting:
    """A painting of labels.

    Attributes
    ----------
    op : Quilted
        Its exemplar is the photo.
    painting : Image
    fine : Image or None
        A painting of labels of the next finer level.
    labels : LabelMap by level
    level : int
        Of the labels of `painting`.
    table : Table or None
        Maps colors to labels; None: paintings are of ids.
    size : Size or None
        None: that of `painting`.
    previous : Path or None
        The plan of an earlier run.
    """

    op: Quilted
    painting: Image
    fine: Image | None
    labels: Mapping[int, LabelMap]
    level: int
    table: Table | None
    size: Size | None
    previous: Path | None

    def coarse(self, budget: int) -> Sewing:
        """The quilting of the first layer."""
        return self._sewing(self.level, self.painting, self.size, "", budget)

    def quilted(
        self, coarse: Sewing, seen: ExemplarPixels, resources: Resources, progress: Progress
    ) -> tuple[dict[str, Quilt], Callable[[Window], SourceMap]]:
        """The layers, by the prefix of their arrays in a plan, the first first; and the sources of a window."""
        stages = progress.stages(*[1] * (1 + (self.fine is not None)))
        base = coarse.quilt(seen, resources, next(stages))
        if self.fine is None:
            return {"": base}, base.sources
        ids, size = self.labels[self.level - 1].ids, Size(base.grid.width, base.grid.height)
        painted = painted_labels(self.fine.first, self._meaning(self.fine.first, np.unique(ids), fine=True), size)
        guide = Image((_overpainted(base, ids, painted),), self.fine.source)
        over = self._sewing(self.level - 1, guide, size, "fine_", resources.budget).quilt(seen, resources, next(stages))
        from ..graphcut.photo import Photo

        lab = Photo.of(seen.values, None, resources.budget).lab
        joined = SeamOverlay(
            lab, base.sources, lambda w: (painted(w) > 0, over.sources(w)),
            Window(0, 0, *size), min(TILE // 4, over.grid.patch // 4),
        )  # fmt: skip
        return {"": base, "fine_": over}, functools.partial(joined.sources, cache=resources.cache)

    def painted(self, size: Size) -> tuple[np.ndarray, SomeRows]:
        """The photo's labels, and those of the first layer at each pixel of a result of that size."""
        ids, first = self.labels[self.level].ids, self.painting.first
        read = painted_labels(first, self._meaning(first, np.unique(ids)), size, strict=False)
        rows = MadeRows((size.height, size.width), np.int64, lambda top, end: read(Window(0, top, size.width, end)))
        return ids, rows

    def _sewing(self, level: int, guide: Image, size: Size | None, prefix: str, budget: int) -> Sewing:
        """The quilting of one layer: the labels of its colors, and the patches to keep."""
        begun = None if self.previous is None else read_begun(self.previous, budget, prefix)
        patch, overlap = self.op.patch, None
        if begun is not None and patch is None:  # an edit keeps the patch size
            patch, overlap = begun.plan.grid.patch, begun.plan.grid.overlap
        return Sewing(
            op=self.op, guide=guide, level=level, size=size, patch=patch, overlap=overlap, begun=begun,
            meaning=lambda there: self._meaning(guide.first, there),
        )  # fmt: skip

    def _meaning(self, painting: Part, ids: np.ndarray, fine: bool = False) -> Meaning:
        """Labels of a painting: colors by the table, ids as they are."""
        return meaning_of(painting, None if painting.spec.nchannels == 1 else self.table, ids, fine)


def _overpainted(base: Quilt, ids: np.ndarray, painted: Callable[[Window], np.ndarray]) -> Part:
    """Labels of the finer level: those painted, else those of the coarse layer's sources."""
    spec = oiio.ImageSpec(base.grid.width, base.grid.height, 1, oiio.UINT32)
    spec.channelnames = ("id",)

    def fetch(window: Window) -> np.ndarray:
        chosen = painted(window)
        return np.where(chosen > 0, chosen, base.sources(window).gather(ids)).astype(np.uint32)[..., None]

    return Part("fine", spec, fetch, spec.format, exact=True)
