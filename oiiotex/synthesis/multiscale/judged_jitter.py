# SPDX-License-Identifier: Apache-2.0
"""How many levels of a single exemplar's plane are jittered: as many as keep its objects whole.

Not in HRRG08. Jitter and correction break what is larger than the pixels of the last jittered level. The judge looks at
a piece of the plane of the exemplar's size, always the same one, so that every window of a plane decides the same.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from ...engine.core.demand import MadeRows
from ...engine.core.window import Window
from ...engine.deferred import np
from ...engine.io.disk_cache import cached_arrays, hash_of
from ...engine.session.progress import Progress
from ..quality.fidelity import Fidelity, fidelity
from ..quality.judged_tries import Try, best_tried
from .infinite_plane import Plane
from .synthesizer import PlaneSettings, Synthesizer

log = logging.getLogger("oiiotex")

_VERSION = "oiiotex jitter 1"
_JITTERED = ((1.0, 1.0, 1.0), (1.0, 1.0))  # from level 1 on: pieces of 1/8, then of 1/4 of the exemplar's side
_MEASURES = "band_96", "band_48", "band_24", "shapes", "lines", "missing", "broken"


def best_jitter(
    flag: str,
    plane: Plane,
    settings: PlaneSettings,
    original: np.ndarray,
    maker: Callable[[PlaneSettings], Synthesizer],
    folder: Path | None,
) -> tuple[PlaneSettings, Fidelity | None]:
    """The settings with the jitter that is judged best, and its fidelity; None if the exemplar is too small.

    `original` (side, side, 3) float32: Lab of the exemplar before flattening. `maker` gives the synthesizer of
    settings; `folder` caches the decision.
    """
    jitters = [settings.jitter, *((0.0, *levels, 0.0) for levels in _JITTERED if len(levels) < plane.finest - 2)]
    key = hash_of(_VERSION, plane.key(settings, plane.finest), jitters, original)

    def with_jitter(jitter: tuple[float, ...]) -> Try[Synthesizer]:
        return Try(_spelled(jitter), lambda _: maker(replace(settings, jitter=jitter)))

    def decided() -> tuple[np.ndarray, ...]:
        best = best_tried(flag, map(with_jitter, jitters), lambda made: _judged(plane, made, original), Progress())
        measures = {} if best.kept is None else best.kept.measures()
        number = [_spelled(one) for one in jitters].index(best.spelled)
        return (np.array([number, *(measures.get(name, np.nan) for name in _MEASURES)]),)

    number, *values = cached_arrays(folder, key, decided)[0].tolist()
    known = {name: value for name, value in zip(_MEASURES, values, strict=True) if not np.isnan(value)}
    kept = Fidelity.of_measures(known) if known else None
    return replace(settings, jitter=jitters[int(number)]), kept


def spelled(settings: PlaneSettings) -> str:
    """The modifier that requests the settings' jitter."""
    return _spelled(settings.jitter)


def _spelled(jitter: tuple[float, ...]) -> str:
    return "jitter=" + ",".join(f"{rho:g}" for rho in jitter)


def _judged(plane: Plane, maker: Synthesizer, original: np.ndarray) -> Fidelity | None:
    root = plane.exemplars[0]
    source = plane.source(maker.window(plane.finest, Window(0, 0, root.side, root.side)))
    photo = root.values[..., :3]
    source = source.of(*source.yx)  # a place of the exemplar, whatever the level of its texel
    result = MadeRows(photo.shape, np.float32, lambda first, last: source[first:last].gather(photo))
    return fidelity(photo, root.opaque, result, (False, False), source, original)
