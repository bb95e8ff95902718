# SPDX-License-Identifier: Apache-2.0
"""How large the patches are from which a single exemplar's plane starts: large enough to keep its objects whole.

Not in HRRG08. The judge looks at a piece of the plane of the photo's size, always the same one, so that every window of
a plane decides the same.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from ...engine.core.demand import MadeRows
from ...engine.core.source_map import SourceMap
from ...engine.core.window import Window
from ...engine.deferred import np
from ...engine.io.disk_cache import cached_arrays, hash_of
from ...engine.session.progress import Progress
from ..quality.fidelity import Fidelity, fidelity
from ..quality.judged_tries import Try, best_tried
from .infinite_plane import Plane
from .plane_quilt import PlaneQuilt, patch_of
from .synthesizer import PlaneSettings, Synthesizer

_VERSION = "oiiotex plane quilt 1"
_SHARES = 8, 4, 2.67  # the photo's shorter side over that of a patch
_MEASURES = "band_96", "band_48", "band_24", "shapes", "lines", "missing", "broken"


def best_quilt(
    flag: str,
    plane: Plane,
    settings: PlaneSettings,
    period: tuple[int, int],
    original: np.ndarray,
    quilted: Callable[[int], PlaneQuilt],
    maker: Callable[[PlaneSettings], Synthesizer],
    folder: Path | None,
) -> tuple[PlaneSettings, Fidelity | None]:
    """The settings with the start that is judged best, and its fidelity; None if the exemplar is too small.

    `original` (height, width, 3) float32: Lab of the exemplar before flattening. `quilted` gives the start with patches of
    a side, `maker` the synthesizer of settings; `folder` caches the decision.
    """
    patches = list(dict.fromkeys(patch_of(plane.exemplars[0], share, period) for share in _SHARES))
    key = hash_of(_VERSION, plane.key(settings, plane.finest), patches, period, original)

    def with_patch(patch: int) -> Try[PlaneQuilt]:
        return Try(f"patches of {patch} px", lambda _: quilted(patch))

    def judged(quilt: PlaneQuilt) -> Fidelity | None:
        return _judged(plane, maker(replace(settings, quilt=quilt)), original)

    def decided() -> tuple[np.ndarray, ...]:
        best = best_tried(flag, map(with_patch, patches), judged, Progress())
        measures = {} if best.kept is None else best.kept.measures()
        values = np.array([measures.get(name, np.nan) for name in _MEASURES])
        return np.array([best.made.level]), best.made.source.packed, values

    level, packed, values = cached_arrays(folder, key, decided)
    known = {name: value for name, value in zip(_MEASURES, values.tolist(), strict=True) if not np.isnan(value)}
    quilt = PlaneQuilt(int(level[0]), key, SourceMap(packed))
    return replace(settings, quilt=quilt), Fidelity.of_measures(known) if known else None


def _judged(plane: Plane, maker: Synthesizer, original: np.ndarray) -> Fidelity | None:
    root = plane.exemplars[0]
    source = plane.source(maker.window(plane.finest, Window(0, 0, *root.place.size)))
    photo = np.ascontiguousarray(root.values[root.photo][..., :3])
    source = source.of(*source.yx)  # a place of the exemplar, whatever the level of its texel
    result = MadeRows((*source.packed.shape, 3), np.float32, lambda first, last: source[first:last].gather(photo))
    usable = None if root.opaque is None else root.opaque[root.photo]
    return fidelity(photo, usable, result, (False, False), source, original)
