# SPDX-License-Identifier: Apache-2.0
"""Quantiles of Pearson distributions by skewness and kurtosis, in a table shared with cl/moments.cl.

The table is part of the package, created by `python -m tests.reference.pearson`: scipy's
distributions take a second to import, and a stored table is independent of the version of scipy.
"""

from __future__ import annotations

import functools
from importlib import resources
from typing import TypeVar

import numpy as np

SKEWNESSES, KURTOSES, SCORES = 33, 33, 65  # entries of the table
MOST_SKEWNESS, MOST_EXCESS = 9.0, 60.0  # of the table; larger values are clamped
HALF_SKEWNESS, HALF_EXCESS = 1.0, 2.0  # `bent` of these is 1/2
TABLE_FILE = "pearson_table.npz"
Value = TypeVar("Value", float, np.ndarray)


@functools.cache
def _table() -> dict[str, np.ndarray]:
    with (resources.files("oiiotex.synthesis.projections") / TABLE_FILE).open("rb") as file, np.load(file) as table:
        arrays = dict(table)
    for array in arrays.values():
        array.setflags(write=False)
    return arrays


def table_shares() -> np.ndarray:
    """The shares of `quantile_table`, (SCORES,): dense in the tails of distributions."""
    return _table()["shares"]


def quantile_table() -> np.ndarray:
    """Quantiles at `table_shares`: (SKEWNESSES, KURTOSES, SCORES) float32, at `table_place`.

    Between its entries quantiles are interpolated, not shares: ends of supports move and do not blur.
    """
    return _table()["quantiles"]


def table_place(skewness: np.ndarray, kurtosis: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Indices of distributions in `quantile_table`: (of skewness with its sign, of kurtosis), fractional.

    In equal steps of g / (1 + g) and e / (2 + e), where g is the skewness and e the kurtosis above its bound.
    """
    size = np.minimum(np.abs(skewness), MOST_SKEWNESS)
    excess = np.clip(kurtosis - 1 - skewness**2, 0, MOST_EXCESS)
    along_skewness = bent(size, HALF_SKEWNESS) / bent(MOST_SKEWNESS, HALF_SKEWNESS) * (SKEWNESSES - 1)
    along_kurtosis = bent(excess, HALF_EXCESS) / bent(MOST_EXCESS, HALF_EXCESS) * (KURTOSES - 1)
    return np.copysign(along_skewness, skewness), along_kurtosis


def bent(value: Value, half: float) -> Value:
    """Map values from 0 to infinity to 0 .. 1, with 1/2 at `half`."""
    return value / (half + value)


def shares_below(places: np.ndarray, skewness_at: float, kurtosis_at: float) -> np.ndarray:
    """The cumulative at fractional indices of the table, as in cl/moments.cl. `places`: in standard deviations."""
    if skewness_at < 0:
        return 1.0 - shares_below(-places, -skewness_at, kurtosis_at)
    table = quantile_table()
    i, j = min(int(skewness_at), SKEWNESSES - 2), min(int(kurtosis_at), KURTOSES - 2)
    u, v = skewness_at - i, kurtosis_at - j
    quantiles = (1 - u) * ((1 - v) * table[i, j] + v * table[i, j + 1])
    quantiles += u * ((1 - v) * table[i + 1, j] + v * table[i + 1, j + 1])
    return np.interp(places, quantiles, table_shares(), left=0.0, right=1.0)
