# SPDX-License-Identifier: Apache-2.0
"""Workloads of `benchmarks.gpu.run`: filters on procedural photos, so that no file is needed.

A workload takes a session and a side in px, prepares what is not timed, and returns the function to time. That
function returns ImageBufs, dicts or lists of them, or arrays.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from importlib import util
from typing import Any

import numpy as np
import OpenImageIO as oiio

from oiiotex import filters
from oiiotex.analysis.superpixels.slic import SeedGrid, Slic
from oiiotex.engine.color.lab import lens_of
from oiiotex.engine.color.lab_on_device import LabGrid
from oiiotex.engine.core.image import from_buffer
from oiiotex.engine.core.op import Space
from oiiotex.engine.session import Session
from oiiotex.synthesis.multiscale.candidate_sets import analyze
from oiiotex.synthesis.multiscale.graph import Graph
from oiiotex.synthesis.multiscale.stacks import load_exemplars
from oiiotex.synthesis.multiscale.targets import stacks_of
from tests import pictures
from tools.demo import gravel, stained

Work = Callable[[], Any]
EXEMPLAR = 512  # px


def buffer_of(pixels: np.ndarray) -> oiio.ImageBuf:
    """(h, w, c) uint8 or float32 as an image, sRGB."""
    kind = oiio.UINT8 if pixels.dtype == np.uint8 else oiio.FLOAT
    made = oiio.ImageBuf(oiio.ImageSpec(pixels.shape[1], pixels.shape[0], pixels.shape[2], kind))
    made.specmod().attribute("oiio:ColorSpace", "srgb_rec709_scene")
    made.set_pixels(made.roi, np.ascontiguousarray(pixels))
    return made


@functools.cache
def photo() -> np.ndarray:
    """(512, 512, 3) uint8: scikit-image's gravel where it is installed, else pebbles; with a stain."""
    if util.find_spec("skimage"):
        return stained(gravel())
    return (255 * pictures.stained(pictures.pebbles(EXEMPLAR, EXEMPLAR, 2)) + 0.5).astype(np.uint8)


def exemplar(side: int = EXEMPLAR) -> oiio.ImageBuf:
    """The photo, cropped if a smaller one is needed."""
    return buffer_of(photo()[:side, :side])


def _large(side: int) -> oiio.ImageBuf:
    """The photo again and again: a picture of any size, made in no time."""
    times = -(-side // EXEMPLAR)
    return buffer_of(np.tile(photo(), (times, times, 1))[:side, :side])


def _grown(name: str, **values: Any) -> Callable[[Session, int], Work]:
    """A filter that makes side x side pixels of the photo; of small ones a part of it."""

    def prepared(session: Session, side: int) -> Work:
        source = exemplar(min(EXEMPLAR, side))
        return lambda: getattr(filters, name)(source, size=(side, side), session=session, **values)

    return prepared


def _held(session: Session, side: int) -> Work:
    """A disc filled from around it."""
    source = _large(side)
    y, x = np.indices((side, side))
    disc = buffer_of((np.hypot(y - side / 2, x - side / 2) < 0.3 * side)[..., None].astype(np.float32))
    return lambda: filters.fill(source, disc, session=session)


def _zoom(session: Session, side: int) -> Work:
    source = exemplar(min(EXEMPLAR, side))
    return lambda: filters.zoom(source, size=(side, side), frame=10, speed=0.15, session=session)


def _synth(session: Session, side: int) -> Work:
    """With the analysis of its exemplar in the cache."""
    source = exemplar(min(EXEMPLAR, side))
    filters.synth(source, size=(64, 64), session=session)
    return lambda: filters.synth(source, size=(side, side), session=session)


def _analysis(session: Session, side: int) -> Work:
    """Candidates of an exemplar of 256 px, without the cache. One size for all sides."""
    side = min(256, side)
    graph, image = Graph.single("photo"), from_buffer(exemplar(side))
    exemplars, _ = load_exemplars([image], graph, session.resources, Space.LAB, side)
    stacks = stacks_of(graph, exemplars)

    def work() -> dict[str, np.ndarray]:
        made = analyze(
            session.resources.device, stacks, 16, True, session.resources.budget, session.progress.advance, None
        )
        return {name: array for name, array in vars(made).items() if isinstance(array, np.ndarray)}

    return work


def _superpixel(session: Session, side: int) -> Work:
    """With its hierarchy, which small pictures would not have by themselves."""
    source = _large(side)
    return lambda: filters.superpixel(source, sigmamin=max(5.0, side / 64), sigma=max(20.0, side / 16), session=session)


def _slic(session: Session, side: int) -> Work:
    """Ten iterations, Lab on the device."""
    image = from_buffer(_large(side))
    held = LabGrid(image, lens_of(image, session.resources), session.resources)
    run = Slic(held, SeedGrid.of(side, side, min(44.0, side / 6), 20.0), session.resources)

    def work() -> list[np.ndarray]:
        bands = run.slots(run.iterate(10))
        return [session.resources.device.read(slots, (band.bottom - band.top, side), np.uint8) for band, slots in bands]

    return work


def _labeled(session: Session) -> Any:
    halves = pictures.bricks(128, 96, 1), pictures.moss(128, 96, 2)
    pixels = (255 * np.concatenate(halves, 1) + 0.5).astype(np.uint8)
    return filters.label(buffer_of(pixels), photo=True, session=session)


def _composite(session: Session, side: int) -> Work:
    source = _labeled(session)
    return lambda: filters.composite(source, size=(side, side), patch=16, seed=2, session=session)


def _palette(session: Session, side: int) -> Work:
    source = _labeled(session)
    return lambda: filters.palette(source, panel=32, session=session)


def _paint(session: Session, side: int) -> Work:
    source = _labeled(session)
    checks = buffer_of(1 + (np.indices((side, side)).sum(0) // 60 % 2)[..., None].astype(np.float32))
    return lambda: filters.paint(source, checks, patch=16, session=session)


# Timed at every size, most wanted first; the others at the first size, for the sake of their kernels.
AT_EVERY_SIZE: dict[str, Callable[[Session, int], Work]] = {
    "texsynth": _synth,
    "SLIC, ten iterations": _slic,
    "texstationarize": _grown("stationarize"),
    "texquilt": _grown("quilt", tiles="xy"),
    "texsuperpixel": _superpixel,
}
TIMED = AT_EVERY_SIZE | {
    "texsynth's analysis, 256 px": _analysis,
    "texstationarize:measure=moments": _grown("stationarize", measure="moments4"),
    "texstationarize:measure=steerable": _grown("stationarize", measure="steerable"),
    "texfill": _held,
    "texpatchmatch": _grown("patchmatch"),
    "texcomposite": _composite,
}
COMPARED: dict[str, Callable[[Session, int], Work]] = {
    "texsynth": _synth,
    "texsynth's analysis, 256 px": _analysis,
    "texstationarize": _grown("stationarize", st=True),
    "texstationarize:measure=moments": _grown("stationarize", st=True, measure="moments4"),
    "texstationarize:measure=steerable": _grown("stationarize", st=True, measure="steerable"),
    "texfill": _held,
    "texpatchmatch": _grown("patchmatch", st=True),
    "texquilt": _grown("quilt", st=True, tiles="xy"),
    "texsuperpixel": _superpixel,
    "SLIC, ten iterations": _slic,
    "texzoom": _zoom,
    "texcut": _grown("cut", patch=48, st=True),
    "texcomposite": _composite,
    "texpalette": _palette,
    "texpaint": _paint,
}


def arrays(made: Any, name: str = "") -> dict[str, np.ndarray]:
    """The pixels of whatever a work returns, by part."""
    if isinstance(made, np.ndarray):
        return {name: made}
    if isinstance(made, oiio.ImageBuf):
        return {name: made.get_pixels(made.spec().format, made.roi)}
    items = made.items() if isinstance(made, dict) else ((str(n), one) for n, one in enumerate(made))
    return {key: array for part, one in items for key, array in arrays(one, f"{name}{part} ").items()}
