# SPDX-License-Identifier: Apache-2.0
"""The Python API: each op as a function of ImageBufs, numpy arrays and files."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO as oiio

from ..engine.core.image import Image, Part, cropped, from_array, from_buffer, tagged, to_buffer
from ..engine.core.op import Op, errors_of
from ..engine.core.parameters import nearest
from ..engine.core.window import Window
from ..engine.errors import PYTHON, Error, ImageError, ParameterError, ParameterTypeError, QualityError
from ..engine.io.reading import read
from ..engine.run import Result, run
from ..engine.session import Session
from ..engine.session.resources import Resources
from .python_types import ImageLike, ResultBuf
from .signatures import docstring, replaceable, signature

_COMMON: dict[str, tuple[type | tuple[type, ...], str]] = {  # keywords of all functions, of these types or None
    "colorspace": (str, "the name of a color space"), "roi": (oiio.ROI, "an OpenImageIO.ROI"),
    "nthreads": (int, "a number of threads"), "session": (Session, "a Session"),
    "as_array": ((bool, np.bool_), "True or False"),
}  # fmt: skip
_MOST_CHANNELS = 64  # of an image with few rows; an array of that shape has its channels first

if "IPython" in sys.modules and (_shell := sys.modules["IPython"].get_ipython()):
    from .notebook import register

    register(_shell)


def function_of(op: type[Op]) -> Callable[..., Any]:
    """A function of the op's images (positional) and parameters (keywords), with `session=` for resources.

    Optional images are keywords; their value may be the name of a part of the first image. The function returns an
    ImageBuf (with as_array, an array), or a dict of them by name if more than one output is requested; a list of these
    for several images.
    """

    def function(
        *images: ImageLike,
        colorspace: str | None = None,
        roi: oiio.ROI | None = None,
        nthreads: int = 0,
        session: Session | None = None,
        as_array: bool = False,
        **values: Any,
    ) -> Any:
        common = (("colorspace", colorspace), ("roi", roi), ("nthreads", nthreads), ("session", session))
        try:
            with errors_of(op):
                _require_types(*common, ("as_array", as_array))
                session = session or Session(threads=nthreads)
                bound = _bound(op, images, values, colorspace, session.resources)
                results, failed = session.resources.on_a_device(lambda: _results_of(bound, session, roi, as_array))
        except Error as error:
            error.words = PYTHON
            raise
        result = results if len(results) > 1 else results[0]
        if failed:
            raise QualityError("; ".join(failed), result)
        return result

    function.__name__ = function.__qualname__ = op.name
    function.__doc__ = docstring(op)
    function.__signature__ = signature(op)  # type: ignore[attr-defined]
    return function


def _require_types(*given: tuple[str, Any]) -> None:
    """Refuse keywords of all functions that are of a wrong type."""
    for name, value in given:
        kinds, expected = _COMMON[name]
        if value is not None and not isinstance(value, kinds):
            raise ParameterTypeError(parameter=name, value=value, expected=f"{expected}, not {type(value).__name__}")


def _bound(
    op: type[Op], images: tuple[Any, ...], values: dict[str, Any], colorspace: str | None, resources: Resources
) -> Op:
    declared = op.taken(values)
    many = declared[0] if len(declared) == 1 and declared[0].many else None
    if replaceable(op) and images and images[-1] is None:
        images = images[:-1]
    if not images if many else len(images) != len(declared):
        count = "one image or more" if many else f"{len(declared)} image{'s' * (len(declared) != 1)}"
        names = f" ({', '.join(i.name for i in declared)})" if declared else ""
        raise ParameterTypeError(f"takes {count}{names}, not {len(images)}")
    optional = [i.name for i in op.optional_images()]
    further = op.further_images()
    known = [p.attribute for p in op.parameters()] + optional + ([further.name] if further else [])
    for name in values:
        if name not in known:
            raise ParameterTypeError(f"unknown parameter '{name}'{nearest(name, known)}")
    missing = [p.attribute for p in op.parameters() if p.required and p.attribute not in values]
    if missing:
        raise ParameterTypeError(f"requires {missing[0]}=")
    pictures = tuple(_image(image, resources) for image in images)
    if colorspace is not None:
        resources.color.resolve(colorspace)
        pictures = tuple(tagged(image, colorspace) for image in pictures)
    given: dict[str, Any] = (
        {many.name: pictures} if many else dict(zip((i.name for i in declared), pictures, strict=True))
    )
    for name in optional:
        if values.get(name) is not None:
            given[name] = _keyword(op, name, values[name], pictures[0] if pictures else None, resources)
    if further is not None and further.name in values:
        more = tuple(_image(image, resources) for image in values[further.name])
        values = values | {further.name: more}
    return op(**{**{i.name: None for i in op.images()}, **values, **given})


def _image(given: ImageLike, resources: Resources) -> Image:
    if isinstance(given, (str, os.PathLike)):
        return read(given, resources.cache)
    if not isinstance(given, Mapping):
        return _picture(given)
    if not given:
        raise ImageError("a dict of parts is empty: expected at least one part")
    parts = [replace(_picture(picture).first, name=name) for name, picture in given.items()]
    return Image(tuple(parts), parts[0].name)


def _picture(given: Any) -> Image:
    if isinstance(given, oiio.ImageBuf):
        return from_buffer(given)
    if isinstance(given, np.ndarray):
        _require_photo(given)
        return from_array(given)
    if "PIL.Image" in sys.modules and isinstance(given, sys.modules["PIL.Image"].Image):
        return from_array(_of_pil(given))
    kind = type(given).__name__
    if hasattr(given, "__dask_graph__") and given.__dask_graph__() is not None:  # xarray has it for any array
        raise ParameterTypeError(
            expected=f"an array in memory, not a dask {kind}",
            hint="call its compute(), or give a file name: files are read in pieces",
        )
    alike = hasattr(given, "__array__") or isinstance(given, (list, tuple, memoryview))
    raise ParameterTypeError(
        expected=f"an ImageBuf, an array, a file name or a dict of parts, not {kind}",
        hint="call numpy.asarray on it" if alike else "",
    )


def _require_photo(pixels: np.ndarray) -> None:
    """Refuse an array that looks like an image, but would be read as another one."""
    channels, expected, hint = pixels.shape[2] if pixels.ndim == 3 else 1, "", ""
    if channels > _MOST_CHANNELS and pixels.shape[0] <= 4:
        expected, hint = "(height, width, channels)", "call numpy.moveaxis(array, 0, -1)"
    elif isinstance(pixels, np.ma.MaskedArray):
        expected, hint = "an array without a mask", "give its data, and mask=~array.mask of one channel"
    elif channels > 1 and pixels.dtype.kind in "iu" and pixels.dtype.itemsize == 8:
        expected, hint = "uint8, uint16 or floats", "64-bit integers are label ids"
    if expected:
        kind = f"{type(pixels).__name__} of shape {pixels.shape} and type {pixels.dtype}"
        raise ImageError(f"{kind}: expected {expected}", hint=hint)


def _of_pil(picture: Any) -> np.ndarray:
    """Pixels of a PIL image, upright as its Exif Orientation says; its alpha is unpremultiplied."""
    from PIL import ImageOps  # the caller has imported PIL

    picture = ImageOps.exif_transpose(picture)
    if picture.mode in ("CMYK", "YCbCr", "LAB", "HSV"):
        problem = f"a PIL image of mode {picture.mode}"
        raise ParameterTypeError(expected=f"gray, RGB or RGBA, not {problem}", hint='call its convert("RGB")')
    if picture.mode in ("P", "PA", "LA"):
        picture = picture.convert("RGBA" if picture.has_transparency_data else "RGB")
    pixels = np.asarray(picture)
    if picture.mode != "RGBA":
        return pixels
    alpha = pixels[..., 3:].astype(np.uint32)
    color = (pixels[..., :3] * alpha + 127) // 255
    return np.concatenate([color, alpha], -1).astype(np.uint8)


def _keyword(op: type[Op], name: str, value: ImageLike, first: Image | None, resources: Resources) -> Image:
    if not isinstance(value, str):
        return _image(value, resources)
    part = first.part(value) if first is not None else None
    if part is not None:
        return Image((part,), value)
    if Path(value).exists():
        return read(value, resources.cache)
    has = ", ".join(p.name for p in first.parts) if first is not None else "none"
    raise ParameterError(parameter=name, value=value, expected=f"a part of the image ({has}) or an existing file")


def _results_of(bound: Op, session: Session, roi: oiio.ROI | None, as_array: bool) -> tuple[list[Any], list[str]]:
    """Its images, and the limits that they exceed."""
    results = run(bound, session)
    made = [_buffers(type(bound), one, roi, as_array) for one in results]
    return made, [text for one in results for text in one.failed]


def _buffers(op: type[Op], result: Result, roi: oiio.ROI | None, as_array: bool) -> Any:
    parts = [part if roi is None else _within(part, roi, op) for part in result.image.parts]
    buffers: list[Any] = [to_buffer(part, ResultBuf) for part in parts]
    buffers = [np.asarray(one) for one in buffers] if as_array else buffers
    return buffers[0] if len(buffers) == 1 else dict(zip(result.names, buffers, strict=True))


def _within(part: Part, roi: oiio.ROI, op: type[Op]) -> Part:
    """The part cropped to a region, with unchanged display window and metadata."""
    window = Window(roi.xbegin, roi.ybegin, roi.xend, roi.yend) & part.window if roi.defined else part.window
    if window.empty:
        raise ParameterError(f"roi {roi} is outside the result {part.window}")
    return cropped(part, window)
