# SPDX-License-Identifier: Apache-2.0
"""The measures of a report, and their meaning."""

from __future__ import annotations

REPORT_MEASURES = {
    "cost": "Stationarity cost (MJH17 eq. 1) in Lab, for moments in squared Lab. 0 is stationary.",
    "cost_photo": "The same for the photo.",
    "texture": "Squared Lab distance per pixel between its patches and the photo's (MJH17 eq. 5, upper bound).",
    "seam": "The larger of seam_x and seam_y.",
    "seam_x": "Mean jump across the wrap along x, relative to interior lines (of a lattice: joints). 1 is invisible.",
    "seam_x_photo": "The same for the photo.",
    "seam_y": "As seam_x, along y.",
    "seam_y_photo": "The same for the photo.",
    "quieter_x": "Percentage of interior lines with a smaller jump than the wrap along x. 50 is invisible.",
    "quieter_y": "The same along y.",
    "border": "Mean jump of L across a fill's border, relative to jumps within 12 px around it. 1 is invisible.",
    "step": "Difference of local levels across a fill's border, relative to a line around it. 1 is invisible.",
    "sharp": "Sharpness of a fill, mean |L - blurred L|, relative to its surroundings.",
    "fidelity": "The judge's value, 0 to 1, of the worst of the parts below. Good from 0.8, unusable below 0.67.",
    "broken": "Variance of patches that no place of the photo explains, where cuts are seen: edges count more than"
    " objects. Good up to 0.015. Of an evened tile that was chosen: at most that of the usual tile.",
    "waves": "Standard deviation in Lab of waves with up to 3 periods per side of the tile. Good up to 3.5.",
    "uneven": "The same of the logarithms of fine and coarse detail: rough and plain areas. Good up to 0.16.",
    "salient": "Distance of the most salient area from the typical color, in typical deviations, times the root of how"
    " often it is shown in a tile. Good up to 7.5.",
    "missing": "Fraction of the original photo's pixels whose color is less than half as frequent. Good up to 0.1.",
    "lines": "Fraction of the photo's long lines and lattices that is kept. 1 if it has none.",
    "band_96": "Energy after a Gaussian of the photo's longer side / 96, relative to the photo's.",
    "band_48": "The same for longer side / 48.",
    "band_24": "The same for longer side / 24. Below 1: structure is lost. Above 1: there are blotches.",
    "shapes": "1 minus the difference of autocorrelations up to 1/6 of the longer side. It counts without `broken`.",
    "loss": "Fraction of the photo's sharpness, mean |L - blurred L|, that is lost. Negative: it is sharper.",
    "copied": "Fraction of the pixels that lie in verbatim copies of 8x8 px.",
    "shown": "Number of times that the most repeated region of 32x32 px of the photo is shown.",
    "repeat": "The same, divided by the average of all regions, at least 1.",
    "label_repeat": "The largest repeat within a painted label, divided by the average of the label, at least 1.",
    "label_shown": "Number of times that this region is shown.",
    "label": "Label of this region.",
    "regular": "Minimum autocorrelation above its floor at the lattice's first three vectors. 1 is perfect.",
    "regular_photo": "The same for the photo.",
    "textured": "Fraction of the patches that are not flat.",
    "textured_photo": "The same for the photo.",
}
