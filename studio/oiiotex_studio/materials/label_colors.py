# SPDX-License-Identifier: Apache-2.0
"""Shares and mean colors of a material's labels, for search."""

from __future__ import annotations

from oiiotex.engine.deferred import np

from ..api.images import Image, Resources, lab_of_linear
from ..api.materials import holds_ids, label_maps, opened_level
from .preview import linear_of


def label_colors(labels: Image, color: Image, resources: Resources) -> list[tuple[str, float, list[float]]]:
    """The labels of an image, the largest first; empty if it has no label maps.

    Parameters
    ----------
    labels : Image
        Image with parts label.N. If its first part is the photo (`--texlabel:photo=1`), colors come from the photo.
    color : Image
        Otherwise, the image that colors come from; if its size differs from the maps, the result is empty.

    Returns
    -------
    list of (str, float, list of float)
        Labels of the coarsest level with several: name, share of the pixels (0 to 1), mean color in CIE Lab D65.
    """
    maps = label_maps(labels)
    if not maps:
        return []
    coarsest, photo = maps[opened_level(maps)], color.first if holds_ids(labels.first) else labels.first
    ids = coarsest.ids.astype(np.int64)
    if ids.shape != (photo.spec.height, photo.spec.width):
        return []
    linear = linear_of(photo, resources).reshape(-1, 3)
    areas = np.bincount(ids.ravel())
    sums = np.stack([np.bincount(ids.ravel(), linear[:, channel]) for channel in range(3)], -1)
    lab = lab_of_linear(sums / np.maximum(areas, 1)[:, None])
    chosen = [int(label) for label in np.argsort(-areas, kind="stable") if label and areas[label]]
    return [(coarsest.name(label), float(areas[label] / ids.size), lab[label].tolist()) for label in chosen]
