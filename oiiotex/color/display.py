# SPDX-License-Identifier: Apache-2.0
"""What a display shows of an image: by a display and a view of the config, with an exposure for looking."""

from __future__ import annotations

import functools
from collections.abc import Callable

from ..deferred import np, ocio
from ..errors import ColorError, one_line
from .config import ColorConfig

_PLAIN = "Un-tone-mapped"  # the view of OCIO's own configs that shows textures as their files are


def views(config: ColorConfig) -> dict[str, list[str]]:
    """The config's displays, its default one first, and their views."""
    own = config.config
    displays = [own.getDefaultDisplay(), *own.getDisplays()]
    return {display: list(own.getViews(display)) for display in dict.fromkeys(displays) if own.getViews(display)}


def usual_view(config: ColorConfig, space: str | None) -> tuple[str, str]:
    """The display and view to begin with: the config's, but without a tone curve for what is no scene-linear image."""
    own = config.config
    display = own.getDefaultDisplay()
    linear = space is not None and own.getColorSpace(config.resolve(space)).getEncoding() == "scene-linear"
    plain = _PLAIN in own.getViews(display) and not linear
    return display, _PLAIN if plain else own.getDefaultView(display)


def shown_by(config: ColorConfig, space: str | None, display: str, view: str, exposure: float = 0.0) -> Shown:
    """How pixels of a space look: a function from (height, width, 3) float32 to 8 bits.

    Parameters
    ----------
    config : ColorConfig
    space : str or None
        None, or one of data: shown as they are, less than 0 black, more than 1 white.
    display, view : str
        Of the config.
    exposure : float
        Stops, in the config's scene-linear space.

    Raises
    ------
    ColorError
        The config has no such view, or no way there.
    """
    if space is None or config.is_data(space):
        return functools.partial(_in_bytes, gain=2.0**exposure)
    own, linear = config.config, config.linear
    here = config.resolve(space)
    steps = ocio.GroupTransform()
    if exposure and linear is not None:
        steps.appendTransform(ocio.ColorSpaceTransform(src=here, dst=linear))
        gain = 2.0**exposure
        matrix = [gain if n in (0, 5, 10) else float(n == 15) for n in range(16)]
        steps.appendTransform(ocio.MatrixTransform(matrix=matrix))
        here = linear
    steps.appendTransform(ocio.DisplayViewTransform(src=here, display=display, view=view))
    try:
        processor = own.getProcessor(steps).getDefaultCPUProcessor()
    except (ocio.Exception, ocio.ExceptionMissingFile) as error:
        raise ColorError(f"no way from '{space}' to view '{view}' of '{display}': {one_line(str(error))}") from error

    def shown(pixels: np.ndarray) -> np.ndarray:
        values = np.array(pixels, np.float32, order="C")
        processor.applyRGB(values)
        return _in_bytes(values)

    return shown


Shown = Callable[["np.ndarray"], "np.ndarray"]


def _in_bytes(pixels: np.ndarray, gain: float = 1.0) -> np.ndarray:
    with np.errstate(invalid="ignore"):
        values = np.nan_to_num(np.clip(pixels * np.float32(gain), 0, 1) * 255)
    return np.rint(values).astype(np.uint8)
