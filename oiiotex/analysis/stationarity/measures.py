# SPDX-License-Identifier: Apache-2.0
"""Parameters that select the measure of stationarity (MJH17 section 3)."""

from __future__ import annotations

from pathlib import Path

MEASURES = ("histogram", "moments", "moments3", "moments4", "steerable")
MEASURE = (
    "Statistics that define stationarity. histogram: local histograms. moments: local mean and variance. moments3: also"
    " skewness. moments4: also kurtosis. steerable: responses of steerable filters."
)


def statistics_of(measure: str) -> tuple[str, int]:
    """One of histogram, moments and steerable, and the highest order of moments, 2 to 4."""
    kind = measure.rstrip("34")
    return kind, int(measure.removeprefix(kind) or 2)


def cost_text(cost: float, measure: str, order: int, before: float | None = None) -> str:
    """A cost of MJH17 eq. 1 as text, with the previous cost if given.

    Parameters
    ----------
    cost : float
        >= 0, in Lab units. Moments: in squared Lab units.
    measure : str
        histogram, moments or steerable.
    order : int
        Highest order of moments, 2 to 4.
    before : float, optional
        Cost of the photo, in the same units.
    """
    kind = {"histogram": "", "moments": f" of moments up to {order}", "steerable": " of steerable responses"}[measure]
    change = "" if before is None else f"{before:.2f} -> "
    unit = "Lab^2" if measure == "moments" else "Lab"
    return f"stationarity cost{kind} {change}{cost:.2f} {unit} (MJH17 eq. 1)"


def scale_folder() -> Path:
    """Folder of cached scales for maps of sigmas."""
    from ...engine.io.cache_folders import cache_folder  # not needed for help

    return cache_folder() / "sigmas"
