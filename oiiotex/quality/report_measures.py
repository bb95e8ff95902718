# SPDX-License-Identifier: Apache-2.0
"""The measures of a report, and what each of them says."""

from __future__ import annotations

REPORT_MEASURES = {
    "cost": "how differently it looks from place to place (MJH17 eq. 1): Lab, of moments squared Lab; 0 is stationary",
    "cost_photo": "the same of the photo",
    "texture": "squared Lab distance a pixel between its patches and the photo's (MJH17 eq. 5, upper bound)",
    "seam": "the larger of seam_x and seam_y",
    "seam_x": "mean jump across the wrap along x over that inside (of a lattice, of its joints); 1 is invisible",
    "seam_x_photo": "the same of the photo",
    "seam_y": "as seam_x, along y",
    "seam_y_photo": "the same of the photo",
    "quieter_x": "per cent of the lines inside that are quieter than the wrap along x; 50 is invisible",
    "quieter_y": "the same along y",
    "fidelity": "how much it looks like the photo, 0 to 1: root of the product of the five below; good from 0.8 on",
    "band_96": "energy, over the photo's, of what a Gaussian of the photo's longer side / 96 leaves",
    "band_48": "the same of longer side / 48",
    "band_24": "the same of longer side / 24; below 1 structure is crushed, above 1 there are blotches",
    "shapes": "1 less the difference of the autocorrelations up to 1/6 of the longer side; 0.7 is another piece of it",
    "lines": "share of the photo's long lines and lattices that is kept; 1 where it has none",
    "missing": "share of the photo's colors that it lacks",
    "loss": "share of the photo's sharpness, mean |L - blurred L|, that is gone; below 0: it is sharper",
    "copied": "share of the pixels that lie in verbatim copies of 8x8 px",
    "shown": "how often the most repeated region of 32x32 px of the photo is shown",
    "repeat": "the same over its fair share",
    "label_repeat": "of a painted label: the most repeated region over its fair share of the label's area; the largest",
    "label_shown": "how often that region is shown",
    "label": "the label that it belongs to",
    "regular": "the least autocorrelation over its floor at the first three steps of the lattice; 1 is perfect",
    "regular_photo": "the same of the photo",
    "textured": "share of the patches that are not flat",
    "textured_photo": "the same of the photo",
}
