# SPDX-License-Identifier: Apache-2.0
"""The motion of a flat surface, tracked through a shot (OpenCV)."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any, NamedTuple

from ...engine.deferred import np
from ...engine.errors import Error, ImageError
from ..capture.homography import homography_of, through
from .frame_motion import FrameMotion
from .sampling import grown

if TYPE_CHECKING:
    from collections.abc import Iterator

_FEATURES = 1500
_APART = 6.0  # px between features
_WINDOW = 21  # px; side of the patches that are compared
_LEVELS = 4  # of the pyramid: motion up to about 100 px a frame beyond what is predicted
_NEAR = 1.0  # px; features farther from the common homography do not belong to the surface
_BACK = 0.5  # px; largest error of a feature that is tracked forward and back
_FEWEST = 24  # features
_LEFT = 0.5  # of the key frame's features: with fewer, the frame becomes the next key frame
_SHARE = 0.3  # of the features found again that must lie on one plane
_PASSES = 3
_SHIFT = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.5, 0.5, 1.0))  # OpenCV: pixel centers at 0
_ALONE = 3  # px around the region that its soft border may cover


class SeenFrame(NamedTuple):
    """A frame as the tracker sees it."""

    number: int
    gray: np.ndarray  # (height, width) uint8
    around: np.ndarray  # (height, width) bool: where the surface may be seen


class _KeyFrame(NamedTuple):
    """A frame whose features are followed until too few are left: errors do not add up from frame to frame."""

    view: SeenFrame
    points: np.ndarray  # (n, 1, 2) float32
    matrix: np.ndarray  # frame to plate


def tracked(views: Iterable[SeenFrame]) -> Iterator[tuple[int, FrameMotion]]:
    """The motion of each frame relative to the first, from views in order of time, either way.

    Features around the region are followed (Lucas and Kanade 1981, in pyramids), and the homography of most of them is
    found with MAGSAC++ (Barath et al. 2020).

    Raises
    ------
    Error
        OpenCV is not installed.
    ImageError
        A frame has too few features, or does not show the surface of the frame before it.
    """
    cv2 = _opencv()
    key: _KeyFrame | None = None
    last, step = np.eye(3), np.eye(3)  # key frame to the last frame; the motion between frames, a guess for the next
    previous: SeenFrame | None = None
    for view in views:
        if key is None or previous is None:
            key = _KeyFrame(view, _features(cv2, view), np.eye(3))
            yield view.number, FrameMotion(np.eye(3))
            previous = view
            continue
        found, share = _matrix(cv2, key, view, last @ step)
        if found is None and previous is not key.view:
            key, last = _KeyFrame(previous, _features(cv2, previous), np.linalg.inv(last) @ key.matrix), np.eye(3)
            found, share = _matrix(cv2, key, view, step)
        if found is None:
            found, share = _matrix(cv2, key, view, np.eye(3))
        if found is None:
            raise ImageError(
                f"frame {view.number} does not show the surface of frame {previous.number}: expected one shot without"
                " a cut",
                hint="choose a shorter range of frames, or set motion",
            )
        yield view.number, FrameMotion(np.linalg.inv(found) @ key.matrix)
        step = np.linalg.inv(last) @ found
        last, previous = found, view
        if share < _LEFT:
            key, last = _KeyFrame(view, _features(cv2, view), np.linalg.inv(found) @ key.matrix), np.eye(3)


def _opencv() -> Any:
    try:
        import cv2  # optional: only tracking needs it
    except ImportError as error:
        hint = "run pip install oiiotex[track], or set motion"
        raise Error("tracking requires OpenCV, which is not installed", hint=hint) from error
    cv2.setRNGSeed(0)
    return cv2


def _features(cv2: Any, view: SeenFrame) -> np.ndarray:
    """Corners of the surface in a frame, (n, 1, 2) float32."""
    mask = (255 * view.around).astype(np.uint8)
    points = cv2.goodFeaturesToTrack(view.gray, _FEATURES, 0.01, _APART, mask=mask)
    count = 0 if points is None else len(points)
    if count < _FEWEST:
        raise ImageError(
            f"frame {view.number} has {count} features to track around the region: expected {_FEWEST} or more",
            hint="set motion",
        )
    return points


def _matrix(cv2: Any, key: _KeyFrame, view: SeenFrame, guess: np.ndarray) -> tuple[np.ndarray | None, float]:
    """Key frame to this frame, from a guess, and the share of features found; None if they do not agree.

    Patches are compared in the frame as it is seen through the last matrix: neither scale nor perspective bias them.
    """
    matrix, share, shift, (height, width) = guess, 0.0, np.array(_SHIFT), view.gray.shape
    for _ in range(_PASSES):
        inner = shift @ matrix @ np.linalg.inv(shift)
        seen = cv2.warpPerspective(
            view.gray, inner.T, (width, height), flags=cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP,
            borderMode=cv2.BORDER_REPLICATE,
        )  # fmt: skip
        first = key.points
        second, good, _ = cv2.calcOpticalFlowPyrLK(key.view.gray, seen, first, None, **_how(cv2))
        again, back, _ = cv2.calcOpticalFlowPyrLK(seen, key.view.gray, second, None, **_how(cv2))
        found = (good & back)[:, 0].astype(bool) & (np.abs(again - first).max((1, 2)) < _BACK)
        from_, to = first[:, 0] + 0.5, through(matrix, second[:, 0] + 0.5)
        at = np.floor(to).astype(int)
        found &= ((at >= 0) & (at < (width, height))).all(1)
        found[found] = view.around[at[found, 1], at[found, 0]]
        if found.sum() < _FEWEST:
            return None, 0.0
        pairs = from_[found].astype(float), to[found]
        better, agreed = cv2.findHomography(*pairs, cv2.USAC_MAGSAC, _NEAR, maxIters=5000, confidence=0.9999)
        if better is None or agreed.sum() < max(_FEWEST, _SHARE * found.sum()):
            return None, 0.0
        inliers = agreed[:, 0].astype(bool)
        matrix, share = homography_of(pairs[0][inliers], pairs[1][inliers]), float(agreed.sum()) / len(first)
    return matrix, share


def _how(cv2: Any) -> dict[str, Any]:
    """Settings of Lucas and Kanade's method."""
    criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 40, 1e-3)
    return {"winSize": (_WINDOW, _WINDOW), "maxLevel": _LEVELS, "criteria": criteria}


def gray_view(values: np.ndarray) -> np.ndarray:
    """Color, (height, width, channels) float32, as 8-bit gray; the brightest hundredth is clipped.

    The square root evens out the contrast of linear values: HDR frames otherwise have few gray levels.
    """
    gray = values.mean(2)
    gray = np.sqrt(np.where(np.isfinite(gray), np.maximum(gray, 0), 0))
    low, high = np.percentile(gray, (0.5, 99.0))
    return np.clip((gray - low) * (255.0 / max(float(high - low), 1e-6)), 0, 255).astype(np.uint8)


def surroundings(region: np.ndarray) -> np.ndarray:
    """Where to track: outside the region, up to the longer side of its bounding box away.

    The nearer, the likelier it is the same surface. Without a region, everywhere.
    """
    rows, columns = (np.flatnonzero(region.any(axis)) for axis in (1, 0))
    if not len(rows):
        return np.ones(region.shape, bool)
    reach = max(int(rows[-1] - rows[0]), int(columns[-1] - columns[0]), 64) + 1
    around = np.zeros(region.shape, bool)
    top, left = max(0, rows[0] - reach), max(0, columns[0] - reach)
    around[top : rows[-1] + reach, left : columns[-1] + reach] = True
    return around & ~grown(region, _ALONE + _WINDOW // 2)
