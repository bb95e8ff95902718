# SPDX-License-Identifier: Apache-2.0
"""The motion of a surface in one frame: pixels of the frame mapped to pixels of a plate, and back.

It is fitted to points, or given by files: ST maps, or motion vectors that are chained from frame to frame.

Points are (x, y) in px from the top left of the display window, pixel centers at halves. Matrices multiply row vectors
(x, y, 1), as OpenImageIO's do.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

from ...engine.core.image import Part, dtype_of
from ...engine.deferred import np
from ...engine.errors import ImageError
from ...engine.io.documents import read_arrays
from ..capture.homography import homography_of, through

STEP = 8  # px between the nodes of a bend
NO_SURFACE = "maps pixels to a line or a point: expected the motion of a surface"
_MOST_CONDITION = 1e12  # of a matrix that can be inverted
_ROUNDS = 8  # of the inverse of a bend, which is smooth: each reduces the error by its slope


@dataclass(frozen=True, eq=False)
class FrameMotion:
    """The map from a frame to the plate: a homography, and a smooth offset before it.

    Attributes
    ----------
    matrix : (3, 3) float64
    bend : (rows, columns, 2) float32, optional
        Offset in px of the frame at nodes every `STEP` px, from the first pixel center on. Beyond the frame, its
        border's is used, so that the map is defined for what comes into view later.
    grain : (channels,) float64, optional
        Standard deviation of the grain.
    """

    matrix: np.ndarray
    bend: np.ndarray | None = None
    grain: np.ndarray | None = None

    def onto(self, points: np.ndarray) -> np.ndarray:
        """Points of the frame, (n, 2), on the plate."""
        return through(self.matrix, points if self.bend is None else points + self._offset(points))

    def back(self, points: np.ndarray) -> np.ndarray:
        """Points of the plate, (n, 2), in the frame."""
        flat = through(np.linalg.inv(self.matrix), points)
        found = flat
        for _ in range(_ROUNDS if self.bend is not None else 0):
            found = flat - self._offset(found)
        return found

    def then(self, matrix: np.ndarray) -> FrameMotion:
        """The map followed by a matrix."""
        return FrameMotion(self.matrix @ matrix, self.bend, self.grain)

    def _offset(self, points: np.ndarray) -> np.ndarray:
        """The bend at points, bilinear."""
        assert self.bend is not None
        most = np.array(self.bend.shape[1::-1]) - 1
        at = np.clip((points - 0.5) / STEP, 0, most)
        x, y = np.minimum(at.astype(int), np.maximum(most - 1, 0)).T
        u, v = (at - np.stack([x, y], 1)).T[..., None]
        right, down = np.minimum(x + 1, most[0]), np.minimum(y + 1, most[1])
        top = (1 - u) * self.bend[y, x] + u * self.bend[y, right]
        return (1 - v) * top + v * ((1 - u) * self.bend[down, x] + u * self.bend[down, right])


Shot: TypeAlias = dict[int, FrameMotion]  # of each frame


def nodes(width: int, height: int) -> np.ndarray:
    """Pixel centers every `STEP` px, (rows, columns, 2)."""
    x, y = (np.arange(0, n, STEP) + 0.5 for n in (width, height))
    return np.stack(np.broadcast_arrays(x[None], y[:, None]), -1)


def fitted(points: np.ndarray, targets: np.ndarray, name: str = "motion") -> FrameMotion:
    """The motion that maps nodes, (rows, columns, 2), to points of the plate; raises as `require_plane` does."""
    flat, goal = points.reshape(-1, 2), targets.reshape(-1, 2)
    with np.errstate(all="ignore"):
        matrix = homography_of(flat, goal)
    require_plane(matrix, name)
    bend = through(np.linalg.inv(matrix), goal) - flat
    return FrameMotion(matrix, bend.reshape(points.shape).astype(np.float32))


def require_plane(matrix: np.ndarray, name: str) -> None:
    """Raise ImageError if a matrix cannot be inverted: it maps the frame to a line or a point."""
    if not np.isfinite(matrix).all() or np.linalg.cond(matrix / (np.abs(matrix).max() or 1)) > _MOST_CONDITION:
        raise ImageError(f"{name} {NO_SURFACE}")


def stored(shot: Shot, size: tuple[int, int]) -> dict[str, np.ndarray]:
    """A shot's motion as arrays for a file, with the size of its plate.

    `frames` (n,), `matrices` (n, 3, 3), `plate` (width, height), and `bends` and `grain` if known.
    """
    arrays = {"frames": np.array(list(shot)), "matrices": np.stack([motion.matrix for motion in shot.values()])}
    arrays["plate"] = np.array(size)
    bent = next((motion.bend for motion in shot.values() if motion.bend is not None), None)
    if bent is not None:
        none = np.zeros_like(bent)
        arrays["bends"] = np.stack([none if motion.bend is None else motion.bend for motion in shot.values()])
    grains = [motion.grain for motion in shot.values()]
    if all(grain is not None for grain in grains):
        arrays["grain"] = np.stack(grains)  # type: ignore[arg-type]  # none is None
    return arrays


def read_shot(path: Path, budget: int) -> Shot:
    """The motion of a shot from a file of `stored` arrays.

    Raises
    ------
    ImageError
        It cannot be read, is larger than `budget` bytes, or holds other arrays.
    """
    arrays = read_arrays(path, budget)
    frames, matrices = arrays.get("frames", np.empty(0)), arrays.get("matrices", np.empty(0))
    count, bends = frames.size, arrays.get("bends", np.empty((frames.size, 0, 0, 2)))
    shapes = frames.shape == (count,) and matrices.shape == (count, 3, 3) and bends.ndim == 4
    grains = arrays.get("grain", np.empty((frames.size, 0)))
    shapes = shapes and bends.shape[::3] == (count, 2) and grains.shape[:-1] == (count,)
    numbers = matrices, bends, grains
    shapes = shapes and all(a.dtype.kind == "f" and np.isfinite(a).all() for a in numbers)
    if not (count and shapes and frames.dtype.kind in "iu"):
        raise ImageError(f"{path}: expected the arrays frames (n) and matrices (n, 3, 3) of a shot's motion")
    matrices = matrices.astype(np.float64)
    for number, matrix in zip(frames, matrices, strict=True):
        require_plane(matrix, f"{path}: frame {number}")
    each = zip(frames, matrices, bends, grains, strict=True)
    return {
        int(number): FrameMotion(matrix, bend if bend.size else None, grain if grain.size else None)
        for number, matrix, bend, grain in each
    }


def plate_size(path: Path, budget: int) -> tuple[int, int] | None:
    """Width and height of the plate that a file of `stored` arrays belongs to. None: those of another program."""
    size = read_arrays(path, budget).get("plate")
    if size is None:
        return None
    if size.shape != (2,) or size.dtype.kind not in "iu":
        raise ImageError(f"{path}: expected an array plate (2): width and height")
    return int(size[0]), int(size[1])


# --- motion from files ---


def of_st_map(part: Part, flip: bool, name: str) -> FrameMotion:
    """The motion of a frame from its ST map: for each pixel, its position in the reference frame, 0 to 1."""
    st = _sampled(part, ("s", "t"), name)
    if flip:
        st[..., 1] = 1 - st[..., 1]
    return fitted(nodes(part.spec.width, part.spec.height), st * (part.spec.width, part.spec.height), name)


def after(motion: FrameMotion, part: Part, convention: str, flip: bool, name: str) -> FrameMotion:
    """The motion of a frame from its vectors, px, and the motion of the frame that they lead to."""
    vectors = _sampled(part, (f"{convention}.u", f"{convention}.v"), name)
    if flip:
        vectors[..., 1] *= -1
    at = nodes(part.spec.width, part.spec.height)
    return fitted(at, motion.onto((at + vectors).reshape(-1, 2)).reshape(at.shape), name)


def _sampled(part: Part, channels: tuple[str, str], name: str) -> np.ndarray:
    """Two channels at the nodes of a frame, (rows, columns, 2) float64: those named, or the first two."""
    names = [one.lower() for one in part.spec.channelnames]
    which = [names.index(one) for one in channels] if set(channels) <= set(names) else [0, 1]
    if len(names) < 2 or dtype_of(part.spec) not in (np.float16, np.float32, np.float64):
        raise ImageError(f"{name} has {len(names)} channels of {part.spec.format}: expected two of float or half")
    values = part.pixels()[::STEP, ::STEP, which].astype(np.float64)
    if not np.isfinite(values).all():
        raise ImageError(f"{name} has NaN or Inf values: expected motion in every pixel")
    return values
