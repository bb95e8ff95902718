# SPDX-License-Identifier: Apache-2.0
"""Previews of a running synthesis: its coarse levels, copied from the photo reduced to their size."""

from __future__ import annotations

import functools
from collections.abc import Callable

from ...engine.color.config import as_float
from ...engine.core.demand import MadeRows, resized, rows_of
from ...engine.core.image import Part
from ...engine.core.source_map import SourceMap
from ...engine.deferred import np
from ...engine.session.progress import Onlooker


def coarse_looks(photo: Part, look: Onlooker | None) -> Callable[[SourceMap, tuple[int, int]], object] | None:
    """A callback for `patchmatch.optimization.synthesize` that shows coarse levels; None without an onlooker."""
    if look is None:
        return None
    rows = rows_of(photo)
    values = MadeRows(rows.shape, np.float32, lambda first, last: as_float(rows[first:last]))
    reduced = functools.lru_cache(1)(functools.partial(resized, values))
    return lambda source, size: look(source.gather(reduced(*size)), False)
