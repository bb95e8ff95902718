# SPDX-License-Identifier: Apache-2.0
"""How filters are told which measure of stationarity to take (MJH17 section 3)."""

from __future__ import annotations

from pathlib import Path

from ..errors import ParameterError

MEASURES = ("histogram", "moments", "steerable")
MEASURE = "what must look the same everywhere: local histograms, local moments, or responses of steerable filters"
ORDER = "of measure=moments: up to which; 2 (mean and variance) when left out, 3 adds skewness, 4 kurtosis"


def order_of(measure: str, order: int | None) -> int:
    """The order of moments.

    Raises
    ------
    ParameterError
        One is given for another measure.
    """
    if order is not None and measure != "moments":
        raise ParameterError(f"order={order}: goes with measure=moments, not with measure={measure}")
    return order or 2


def cost_text(cost: float, measure: str, order: int, before: float | None = None) -> str:
    """A cost of MJH17 eq. 1 for people, and what it was before.

    Parameters
    ----------
    cost : float
        >= 0; Lab units, squared ones of moments.
    measure : str
        One of `MEASURES`.
    order : int
        Of moments, 2 to 4.
    before : float, optional
        Of the photo, in the same units.
    """
    kind = {"histogram": "", "moments": f" of moments up to {order}", "steerable": " of steerable responses"}[measure]
    change = "" if before is None else f"{before:.2f} -> "
    unit = "Lab^2" if measure == "moments" else "Lab"
    return f"stationarity cost{kind} {change}{cost:.2f} {unit} (MJH17 eq. 1)"


def scale_folder() -> Path:
    """Where scales of sigmas are kept from one run to the next."""
    from ..opencl.cache_folders import cache_folder  # when it is needed: help asks for none

    return cache_folder() / "sigmas"
