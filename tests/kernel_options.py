# SPDX-License-Identifier: Apache-2.0
"""Every set of build options that the program uses: what is compiled for compilers that are not here.

`conftest.py` holds every program that any test builds against it, and `test_cross_compile.py` the calls in the source.
"""

from __future__ import annotations

from itertools import combinations, product

from oiiotex.analysis.labels.filter_bank import PLANES
from oiiotex.analysis.stationarity.steerable import RADIUS
from oiiotex.synthesis.exemplar.materials import _MOST_CHANNELS
from oiiotex.synthesis.exemplar.patch_synthesis import PATCHES
from oiiotex.synthesis.projections.histograms import BINS, INVERSE
from oiiotex.synthesis.projections.pearson_table import KURTOSES, SCORES, SKEWNESSES

CHANNELS = range(3, _MOST_CHANNELS + 1)
TABLES = {"SKEWNESSES": [SKEWNESSES], "KURTOSES": [KURTOSES], "SCORES": [SCORES]}
# file in cl/: macro: the values that it may have
OPTIONS: dict[str, dict[str, object]] = {
    "affinity": {},
    "atlas": {"CHANNELS": CHANNELS},
    "candidates": {"RUN": [1, 16]},
    "factorization": {},
    "features": {},
    "filter_bank": {"PLANES": [PLANES]},
    "histograms": {"BINS": [BINS], "INVERSE": [INVERSE], "CHANNELS": CHANNELS},
    "moments": {"INVERSE": [INVERSE], **TABLES, "CHANNELS": CHANNELS},
    "multiscale": {"RUN": [1, 16]},
    "patchmatch": {
        "PATCH": range(PATCHES[0], PATCHES[-1] + 1),
        "CHANNELS": CHANNELS,
        "LATTICE": [0, 1, 2],
        "PIECES": [0, 1],
    },
    "potts": {},
    "quilting": {},
    "steerable": {"RADIUS": [RADIUS], "CHANNELS": CHANNELS},
    "slic_seeds": {},
    "superpixels": {},
    "use_prices": {},
}
# of a range the ends and what is usual are compiled; RUN is 1 on a GPU
COMPILED = {"CHANNELS": [3, 6, CHANNELS[-1]], "PATCH": [PATCHES[0], 11, PATCHES[-1]], "RUN": [1]}


def compiled(stem: str) -> list[dict[str, int]]:
    """The sets of macros with which a file is compiled for GPUs: every pair of values of two macros is in one."""
    macros, seen, chosen = OPTIONS[stem], set(), []
    for values in product(*(COMPILED.get(macro, macros[macro]) for macro in macros)):
        pairs = set(combinations(enumerate(values), 2)) or {values}
        if not pairs <= seen:
            seen |= pairs
            chosen.append(dict(zip(macros, values, strict=True)))
    return chosen


def require_known(stem: str, macros: dict[str, int]) -> None:
    """Refuse options that the table does not have."""
    known = OPTIONS.get(stem)
    assert known is not None, f"cl/{stem}.cl is not in tests/kernel_options.py"
    assert set(macros) == set(known), f"{stem}: {macros}: tests/kernel_options.py has {sorted(known)}"
    for name, value in macros.items():
        assert value in known[name], f"{stem}: {name}={value}: tests/kernel_options.py has {known[name]}"
