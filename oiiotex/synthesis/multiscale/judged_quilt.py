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
_SHARES = 8, 4, 8 / 3  # the photo's shorter side over that of a patch
_MEASURES = "band_96", "band_48", "band_24", "shapes", "lines", "missing", "broken"


def best_quilt(
    flag: str,
    plane: Plane,
    settings: PlaneSettings,
    period: tuple[int, int],
    strength: float,
    original: np.ndarray,
    quilted: Callable[[int], PlaneQuilt],
    maker: Callable[[PlaneSettings], Synthesizer],
    folder: Path | None,
) -> tuple[PlaneSettings, Fidelity | None, str]:
    """The settings with the start that is judged best, its fidelity, and its patches in words.

    Parameters
    ----------
    flag : str
        Name of the op, for the log.
    plane : Plane
    settings : PlaneSettings
    period : (int, int)
        Of the start, px.
    strength : float
        With which it keeps the photo's lattice or courses.
    original : (height, width, 3) float32
        Lab of the exemplar before flattening.
    quilted : callable
        The start with patches of a side in px.
    maker : callable
        The synthesizer of settings.
    folder : Path or None
        Caches the decision.

    Returns
    -------
    (PlaneSettings, Fidelity or None, str)
        None: the exemplar is too small to measure.
    """
    patches = list(dict.fromkeys(patch_of(plane.exemplars[0], share, period) for share in _SHARES))
    key = hash_of(_VERSION, plane.key(settings, plane.finest), patches, period, strength, original)

    def with_patch(patch: int) -> Try[tuple[int, PlaneQuilt]]:
        return Try(_spelled(patch), lambda _: (patch, quilted(patch)))

    def judged(made: tuple[int, PlaneQuilt]) -> Fidelity | None:
        return _judged(plane, maker(replace(settings, quilt=made[1])), original)

    def decided() -> tuple[np.ndarray, ...]:
        best = best_tried(flag, map(with_patch, patches), judged, Progress())
        measures = {} if best.kept is None else best.kept.measures()
        patch, quilt = best.made
        facts = np.array([patch, quilt.level, *(measures.get(name, np.nan) for name in _MEASURES)])
        return facts, quilt.source.packed

    facts, packed = cached_arrays(folder, key, decided)
    patch, level, *values = facts.tolist()
    known = {name: value for name, value in zip(_MEASURES, values, strict=True) if not np.isnan(value)}
    best = replace(settings, quilt=PlaneQuilt(int(level), key, SourceMap(packed)))
    return best, Fidelity.of_measures(known) if known else None, _spelled(int(patch))


def _spelled(patch: int) -> str:
    return f"patches of {patch} px"


def _judged(plane: Plane, maker: Synthesizer, original: np.ndarray) -> Fidelity | None:
    root = plane.exemplars[0]
    source = plane.source(maker.window(plane.finest, Window(0, 0, *root.place.size)))
    photo = np.ascontiguousarray(root.values[root.photo][..., :3])
    source = source.of(*source.yx)  # a place of the exemplar, whatever the level of its texel
    result = MadeRows((*source.packed.shape, 3), np.float32, lambda first, last: source[first:last].gather(photo))
    usable = None if root.opaque is None else root.opaque[root.photo]
    return fidelity(photo, usable, result, (False, False), source, original)
