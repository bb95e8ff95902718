# SPDX-License-Identifier: Apache-2.0
"""Labels of a synthesized image by its appearance: the features of the exemplar's labeled superpixels."""

from __future__ import annotations

from typing import NamedTuple
from unittest.mock import patch

import numpy as np
import OpenImageIO as oiio
from scipy.ndimage import distance_transform_edt
from scipy.spatial import cKDTree

from oiiotex.analysis.labels import features
from oiiotex.analysis.superpixels.hierarchy import COARSEST, hierarchy, scales
from oiiotex.analysis.superpixels.superpixels import FINEST, LEAST_SIGMA, superpixels
from oiiotex.engine.color.lab import lens_of
from oiiotex.engine.core.image import from_buffer
from oiiotex.engine.session import Session

GAP = 64  # px between the two, of alpha 0
NEAREST = (1, 3, 5)


class Relabeled(NamedTuple):
    """Labels by the k nearest of the exemplar's superpixels, for each k.

    Attributes
    ----------
    made : dict of int to (H, W) int
        Of the synthesized image.
    exemplar : dict of int to (h, w) int
        Of the exemplar itself, each superpixel by the others.
    """

    made: dict[int, np.ndarray]
    exemplar: dict[int, np.ndarray]


def relabeled(exemplar: np.ndarray, ids: np.ndarray, made: np.ndarray, rho: float) -> Relabeled:
    """Labels of uint8 pixels (H, W, 3) and of the exemplar (h, w, 3), whose labels of scale `rho` are `ids` (h, w).

    Both stand in one image, so that they have the same textons and the same superpixels' scales; those of labels are
    of the level that was labeled, and textons are looked for at the exemplar's own reduction.
    """
    height, width = exemplar.shape[:2]
    both = np.zeros((max(height, len(made)), width + GAP + made.shape[1], 4), np.uint8)
    both[:height, :width, :3], both[:height, :width, 3] = exemplar, 255
    both[: len(made), width + GAP :, :3], both[: len(made), width + GAP :, 3] = made, 255
    spec = oiio.ImageSpec(both.shape[1], both.shape[0], 4, oiio.UINT8)
    spec.alpha_channel = 3
    spec.attribute("oiio:ColorSpace", "srgb_rec709_scene")
    buffer = oiio.ImageBuf(spec)
    buffer.set_pixels(buffer.roi, both)
    image, resources = from_buffer(buffer), Session().resources
    finest = max(LEAST_SIGMA, FINEST * min(height, width))
    found = superpixels(image, lens_of(image, resources), resources, sigma=finest)
    steps = scales(finest, COARSEST * min(height, width))
    levels = hierarchy(found, resources, np.append(steps[steps < rho], max(rho, finest)))
    groups = levels.partition(len(levels.counts) - 1)
    times = int(np.ceil(np.sqrt(height * width / features.WORKING_PIXELS)))
    with patch.object(features, "WORKING_PIXELS", -(-both.shape[0] * both.shape[1] // times**2)):
        points = features.features_of("textons", found, features.small_lab(found), resources)(groups)
    at = found.labels.read(found.window)[..., 0].astype(np.int64)
    at = np.concatenate([[-1], groups])[at]
    there, here = at[:height, :width], at[: len(made), width + GAP :]
    count = int(ids.max()) + 1
    held = np.bincount(there.ravel() * count + ids.ravel(), minlength=len(points) * count).reshape(-1, count)
    known = np.flatnonzero(held.sum(1))
    labels = held[known].argmax(1)
    tree = cKDTree(points[known])

    def voted(near: np.ndarray) -> np.ndarray:
        votes = (labels[near][..., None] == np.arange(count)).sum(1) + 1e-3 * (labels[near[:, :1]] == np.arange(count))
        return votes.argmax(1)

    distances, near = tree.query(points, max(NEAREST) + 1)
    apart = near.copy()  # a superpixel of the exemplar is not its own neighbor
    own = np.full(len(points), -1)
    own[known] = np.arange(len(known))
    for n in known:
        others = near[n][near[n] != own[n]]
        apart[n] = np.resize(others, near.shape[1])
    return Relabeled({k: voted(near[:, :k])[here] for k in NEAREST}, {k: voted(apart[:, :k])[there] for k in NEAREST})


def far_from_borders(ids: np.ndarray, distance: float) -> np.ndarray:
    """Where the next pixel of another id is further than `distance` px, (h, w) bool."""
    edge = np.zeros(ids.shape, bool)
    for axis in (0, 1):
        unlike = np.diff(ids, axis=axis) != 0
        before, after = (tuple(s if a == axis else slice(None) for a in (0, 1)) for s in (slice(-1), slice(1, None)))
        edge[before] |= unlike
        edge[after] |= unlike
    return distance_transform_edt(~edge) > distance if edge.any() else ~edge
