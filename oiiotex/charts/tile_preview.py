# SPDX-License-Identifier: Apache-2.0
"""A tile as it is seen when it is used: repeated, and on a plane in perspective to the horizon (MJH17 section 5.2)."""

from __future__ import annotations

from ..deferred import np

TILES_ACROSS = 2.0  # at the near edge of the plane
HORIZON = 1.0 / 8.0  # of the picture's height, from above
_NEAREST_HORIZON = 1e-3  # px below it, where a row ends that reaches it


def area_means(image: np.ndarray, start: np.ndarray, stop: np.ndarray) -> np.ndarray:
    """Exact means of a periodic image over stretches of its first axis: no aliasing, however long they are.

    Parameters
    ----------
    image : (n, ...) float
        Value i covers [i, i + 1), and repeats with period n.
    start, stop : (m,) float
        Ends of the stretches, anywhere; start < stop.

    Returns
    -------
    (m, ...) float64
    """
    n = len(image)
    sums = np.zeros((n + 1, *image.shape[1:]))
    np.cumsum(image, axis=0, out=sums[1:])

    def integral(t: np.ndarray) -> np.ndarray:
        turns = np.floor(t / n)
        inside = t - turns * n
        i = np.minimum(inside.astype(np.int64), n - 1)
        wide = (slice(None),) + (None,) * (image.ndim - 1)
        return turns[wide] * sums[-1] + sums[i] + (inside - i)[wide] * image[i]

    length = (stop - start)[(slice(None),) + (None,) * (image.ndim - 1)]
    return (integral(stop) - integral(start)) / length


def repeated(tile: np.ndarray, times: int, height: int) -> np.ndarray:
    """The tile laid out `times` x `times`, reduced or enlarged to a height in px: (height, width, channels) float64."""
    width = max(1, round(height * tile.shape[1] / tile.shape[0]))
    down = np.linspace(0, times * tile.shape[0], height + 1)
    right = np.linspace(0, times * tile.shape[1], width + 1)
    rows = area_means(tile, down[:-1], down[1:])
    return area_means(rows.swapaxes(0, 1), right[:-1], right[1:]).swapaxes(0, 1)


def plane_in_perspective(tile: np.ndarray, width: int, height: int) -> np.ndarray:
    """A plane covered with the tile, seen from above it, the view level: the paper's stress test.

    Every pixel is the mean of what it covers of the plane, a rectangle to first order. Above the horizon there is 0.

    Parameters
    ----------
    tile : (rows, columns, channels) float
    width, height : int
        Of the picture, px.

    Returns
    -------
    (height, width, channels) float64
    """
    eye, away = eye_and_away(tile.shape[1], width, height)
    horizon = height - len(away) + 1
    rows = area_means(tile, away[1:], away[:-1])
    picture = np.zeros((height, width, tile.shape[2]))
    borders = np.arange(width + 1) - width / 2
    for y, row in enumerate(rows):
        across = borders * eye / (y + 0.5)
        picture[horizon + y] = area_means(row, across[:-1], across[1:])
    return picture


def eye_and_away(tile: int, width: int, height: int) -> tuple[float, np.ndarray]:
    """Height of the camera above the plane, and how far away borders of rows are, the horizon first.

    Parameters
    ----------
    tile : int
        Its width, px: the unit of both.
    width, height : int
        Of the picture, px.
    """
    below = np.arange(height - round(height * HORIZON) + 1, dtype=np.float64)  # the borders, px below the horizon
    near = TILES_ACROSS * tile  # focal length `width`: at this distance so many tiles are seen across
    eye = float(below[-1]) * near / width
    return eye, width * eye / np.maximum(below, _NEAREST_HORIZON)


def made_seamless(photo: np.ndarray) -> np.ndarray:
    """The photo blended with itself shifted by half along both axes, as paint programs make an image seamless.

    A baseline of MJH17 section 5.2. The shifted copy has its own borders in the middle, where it must not show, and is
    all there is at the photo's borders: with u and v the distances from the middle lines, 0 .. 1, it counts as
    u v / (u v + (1 - u) (1 - v)).

    Parameters
    ----------
    photo : (height, width, channels) float

    Returns
    -------
    (height, width, channels) float64
    """
    v, u = (np.abs(2 * (np.arange(n) + 0.5) / n - 1) for n in photo.shape[:2])
    return blended(photo, np.roll(photo, (photo.shape[0] // 2, photo.shape[1] // 2), (0, 1)), v, u)


def blended(photo: np.ndarray, shifted: np.ndarray, v: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Some rows of it, from those of the photo and of its shifted copy, and their v and u."""
    both, neither = v[:, None] * u[None, :], (1 - v)[:, None] * (1 - u)[None, :]
    share = (both / (both + neither))[..., None]
    return (1 - share) * photo + share * shifted
