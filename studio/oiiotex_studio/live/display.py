# SPDX-License-Identifier: Apache-2.0
"""Images as a display shows them: through a display and view of the config, with an exposure."""

from __future__ import annotations

import functools
from collections.abc import Callable

from oiiotex.engine.deferred import np, ocio
from oiiotex.engine.errors import ColorError, one_line

from ..api.images import ColorConfig

_PLAIN = "Un-tone-mapped"  # the view of OCIO's built-in configs without a tone curve


def views(config: ColorConfig) -> dict[str, list[str]]:
    """The config's displays, the default one first, and their views."""
    own = config.config
    displays = [own.getDefaultDisplay(), *own.getDisplays()]
    return {display: list(own.getViews(display)) for display in dict.fromkeys(displays) if own.getViews(display)}


def usual_view(config: ColorConfig, space: str | None) -> tuple[str, str]:
    """The initial display and view: the config's defaults, without a tone curve unless the image is scene-linear."""
    own = config.config
    display = own.getDefaultDisplay()
    linear = space is not None and own.getColorSpace(config.resolve(space)).getEncoding() == "scene-linear"
    plain = _PLAIN in own.getViews(display) and not linear
    return display, _PLAIN if plain else own.getDefaultView(display)


def shown_by(config: ColorConfig, space: str | None, display: str, view: str, exposure: float = 0.0) -> Shown:
    """A function that converts pixels of a color space, (height, width, 3) float32, to 8 bits for display.

    Parameters
    ----------
    config : ColorConfig
    space : str or None
        None or a data space: values are shown unchanged, clamped to 0 to 1.
    display, view : str
        Names in the config.
    exposure : float
        Stops, applied in the config's scene-linear space.

    Raises
    ------
    ColorError
        The config has no such view, or cannot convert to it.
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
        problem = f"cannot convert from '{space}' to view '{view}' of '{display}': {one_line(str(error))}"
        raise ColorError(problem) from error

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
