# SPDX-License-Identifier: Apache-2.0
"""--texstationarize and its baseline --texpatchmatch: MJH17."""

from __future__ import annotations

import logging
import os
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar

import numpy as np
import OpenImageIO as oiio

from ..errors import ParameterError
from ..images import Image, Part, derived_spec
from ..op import Op, Output, Reach, Space
from ..params import Numbers, Size, image, param
from ..session import Session
from ..synthesis.guidance import Guidance, Held
from ..synthesis.patchmatch import hash_at, unpack
from ..synthesis.perception import PALETTE, Palette, perceived_scale
from ..synthesis.stationarize import Recipe, Synthesis, synthesize
from ..synthesis.wang import edges_of, runs_for, wang_tiles
from ..windows import Window
from ..writing import write
from .materials import KINDS_HELP, MATCH_HELP, read_material
from .measures import MEASURE, MEASURES, ORDER, order_of, scale_folder
from .prescribed import SIGMAMAP, WEIGHT, WITHIN, marked_pixels, remade_places, sigmas_of, weights_of
from .sources import LABEL, LABELS, LEVEL, MASK, both, ruled_out, say_what_stays, source_pixels

log = logging.getLogger("oiiotex")

EDGES = "oiiotex:edges"  # the attribute that says the colours of a tile's edges
_PATCHES = tuple(range(5, 23, 2))
_ST = Output(
    "st", "where every pixel comes from: 32-bit float source coordinates, as --texwarp and --st_warp read them"
)


@dataclass(frozen=True, kw_only=True)
class _PatchSynthesis(Op):
    """What both ops share: inputs, how a recipe becomes an image, the report."""

    copies: ClassVar[bool] = True
    reach: ClassVar[Reach] = Reach.GLOBAL
    space: ClassVar[Space] = Space.LAB
    outputs: ClassVar[tuple[Output, ...]] = (
        Output(
            "tile",
            "pixels copied from the photo, all channels together, in its own colour space and type; of n maps n images,"
            " in their order; of variants that many",
        ),
        _ST,
    )

    exemplar: Image = image(help="the photo; of n maps of a material, the first")
    maps: tuple[Image, ...] = image((), help="the other maps of the material, made anew with it", count="n")
    mask: Image | None = image(None, help=MASK)
    within: Image | None = image(None, help=WITHIN)
    weight: Image | None = image(None, help=WEIGHT)
    labels: Image | None = image(None, help=LABELS)
    n: int = param(1, ge=1, le=16, help="how many maps of one material are made together, the last images of the stack")
    kinds: str | None = param(None, help=KINDS_HELP)
    match: Numbers | None = param(None, ge=0, help=MATCH_HELP)
    label: int | None = param(None, ge=1, help=LABEL)
    level: int | None = param(None, ge=1, help=LEVEL)
    size: Size | None = param(None, ge=5, le=65536, unit="px", help="of the result; the exemplar's own when left out")
    tile: str | None = param(
        None,
        choices=("xy", "x", "y", "none", None),
        help="along which axes the result tiles; when left out xy, with within none",
    )
    variants: int = param(
        1,
        ge=1,
        le=64,
        help="so many different tiles that go beside each other: up to 7 any beside any; from 8 on edges have two"
        " colours (16 is the whole set of Wang tiles), which part names and the attribute oiiotex:edges say",
    )
    patch: int = param(
        11, choices=_PATCHES, unit="px", help="side of a patch: the scale up to which detail is copied whole"
    )
    iterations: int = param(30, ge=1, le=1000, help="on the coarsest level; each finer one has 3")
    seed: int = param(0, ge=0, le=2**32 - 1, help="same seed, same pixels")
    uniformity: float = param(
        0.01,
        ge=0,
        le=1,
        help="how strongly the use of all parts of the exemplar is evened out; above 0.1 it costs coherence",
    )
    stmap: bool | Path = param(False, help="1: source coordinates as part 'st' of the result; a file name: there")
    data: bool = param(False, help="the channels are no colours: compare them as they are")

    def recipe(self, width: int, height: int) -> Recipe:
        """What to synthesize at this size."""
        raise NotImplementedError

    def _recipe(self, width: int, height: int, sigma: float | None, contrast: float, flat: bool) -> Recipe:
        return Recipe(
            width=width,
            height=height,
            wrap_x="x" in self.tiling,
            wrap_y="y" in self.tiling,
            # twice the tile is a flat window already
            sigma=None if sigma is None else min(sigma, 2.0 * max(width, height)),
            patch=self.patch,
            iterations=self.iterations,
            seed=self.seed,
            uniformity=self.uniformity,
            contrast=contrast,
            flat=flat,
        )

    def compute(self, session: Session) -> Image | tuple[Image, ...]:
        """The tile, followed by the part 'st' where it is asked for; of several maps and variants one image each."""
        maps = (self.exemplar, *self.maps)
        self._check(maps)
        source = self.exemplar.first
        width, height = self.size or Size(source.spec.width, source.spec.height)
        with session.stats.time("read and colour"):
            material = read_material(maps, self.kinds, self.match, self.data, session)
            pixels = [image.first.pixels() for image in maps]
            allowed = source_pixels(self.exemplar, self.mask, self.labels, self.level, self.label)
            marked = None if self.within is None else marked_pixels(self.within, self.exemplar)
            weight = None if self.weight is None else weights_of(self.weight, self.exemplar)
            sigmas = self.sigmas(width, height)
        for more in (None if marked is None else ~marked, None if weight is None else weight > 0):
            allowed = both(allowed, more)
        usable = both(material.opaque, allowed)
        recipe = self.recipe(width, height)
        why = ruled_out(material.opaque, allowed)
        recipe = self.controlled(recipe, material.values, usable, why, session)
        if sigmas is not None:  # of what has one sigma for all, the photo made stationary
            recipe = replace(recipe, sigma=float(np.exp(np.log(sigmas).mean())))
        budget = session.budget - sum(p.nbytes for p in pixels)

        def run(recipe: Recipe, guidance: Guidance, advance: Callable[[int, int], None] = session.advance) -> Synthesis:
            return synthesize(session.device, material.values, usable, recipe, budget, advance, why, guidance)

        guidance = Guidance(weight=weight, sigmas=sigmas)
        if self.variants > 1:
            return self._variants(maps, pixels, recipe, guidance, run, session)
        if marked is not None:
            if not marked.any():
                log.warning("%s: within marks no pixel: the photo stays as it is", self.flag())
            places = remade_places(marked, material.opaque, recipe, guidance, run)
        else:
            made = run(recipe, guidance)
            places = made.source
        session.device.collect(session.stats)
        if session.measure and marked is None:
            with session.stats.time("measure"):
                from .tilereport import report

                report(self.flag(), material.lab, made, recipe, session)
        tiles = tuple(
            tile_image(self, image, p, places, session, first=image is self.exemplar, as_it_was=marked is not None)
            for image, p in zip(maps, pixels, strict=True)
        )
        return tiles if self.maps else tiles[0]

    def sigmas(self, width: int, height: int) -> np.ndarray | None:
        """The sigma at each pixel of a result of this size, where they differ."""
        return None

    def controlled(
        self, recipe: Recipe, values: np.ndarray, usable: np.ndarray | None, why: str, session: Session
    ) -> Recipe:
        """The recipe with what follows from the photo."""
        return recipe

    def _check(self, maps: tuple[Image, ...]) -> None:
        """Refuse modifiers that do not go together."""
        for one in maps:
            refuse_overwriting(one, stmap=self.stmap)
        if self.n != len(maps):
            raise ParameterError(f"n={self.n}: there are {len(maps)} maps")
        own = Size(self.exemplar.first.spec.width, self.exemplar.first.spec.height)
        if self.within is not None and self.size not in (None, own):
            raise ParameterError(f"size={self.size}: with within the result is as large as the photo, {own}")
        if self.variants > 1:
            wrong = "within" if self.within is not None else "stmap" if isinstance(self.stmap, Path) else ""
            wrong = wrong or ("" if self.tiling == "xy" else f"tile={self.tile}")
            if wrong:
                raise ParameterError(f"variants={self.variants} does not go with {wrong}")

    @property
    def tiling(self) -> str:
        """Along which axes the result tiles."""
        return self.tile or ("xy" if self.within is None else "none")

    def _variants(
        self, maps: tuple[Image, ...], pixels: list[np.ndarray], recipe: Recipe, guidance: Guidance,
        run: Callable[..., Synthesis], session: Session,
    ) -> tuple[Image, ...]:  # fmt: skip
        """Tiles with matching edges, each followed by the other maps of its material."""
        runs = runs_for(self.variants)
        session.require(4 * recipe.width * recipe.height * (runs + 1), f"a set of {self.variants} tiles")

        def make(held: Held | None, number: int, tiles: bool) -> np.ndarray:
            seed = int(hash_at(self.seed, 0x3A95, np.array([number]), np.array([0]))[0])
            own = replace(recipe, wrap_x=tiles, wrap_y=tiles, seed=seed)

            def advance(done: int, total: int) -> None:
                session.advance(number * total + done, runs * total)

            return run(own, replace(guidance, held=held), advance).source

        found = wang_tiles(make, self.variants, recipe.width, recipe.height, recipe.patch)
        session.device.collect(session.stats)
        tiles = []
        for number, (places, edges) in enumerate(zip(found, edges_of(self.variants), strict=True)):
            for one, p in zip(maps, pixels, strict=True):
                tile = tile_image(self, one, p, places, session, first=one is self.exemplar)
                tiles.append(named(tile, f"wang{number:02d}_{edges}", {EDGES: str(edges)}))
        return tuple(tiles)


@dataclass(frozen=True, kw_only=True)
class Stationarize(_PatchSynthesis):
    """Turn a photo into a texture that tiles without visible repetition.

    Gradients of light, stains and other slow drift repeat visibly when a photo is tiled. This filter synthesizes the
    photo anew from its own patches while it makes local histograms, or another measure, the same everywhere above a
    scale sigma (MJH17: Moritz, James, Haines, Ritschel, Weyrich, Texture Stationarization, Eurographics 2017). Every
    pixel of the result is a copy of one pixel of the photo.
    """

    name: ClassVar[str] = "stationarize"

    sigmamap: Image | None = image(None, help=SIGMAMAP)
    sigma: float | None = param(
        None,
        ge=0.5,
        le=1e6,
        unit="px",
        help="scale above which the texture must look the same everywhere; longer side / 32 when left out",
    )
    amount: float | None = param(
        None,
        ge=0,
        le=1,
        help="instead of sigma: how stationary it shall look, in even steps that hang on the photo (see --texsigmas)",
    )
    contrast: float | None = param(
        None,
        ge=0,
        le=1,
        help="how strongly the overall histogram is held to the target's; 0: not at all; when left out 0.7, with"
        " within 0",
    )
    target: str = param(
        "flat",
        choices=("flat", "exemplar"),
        help="the histogram that contrast holds to: that of the photo made stationary, or (as in the paper, fading out"
        " over the coarsest level) of the photo",
    )

    measure: str = param("histogram", choices=MEASURES, help=MEASURE)
    order: int | None = param(None, ge=2, le=4, help=ORDER)

    def recipe(self, width: int, height: int) -> Recipe:
        """MJH17 by the measure that was asked for."""
        order = order_of(self.measure, self.order)
        sigma = self.sigma or max(width, height) / 32
        contrast = self.contrast if self.contrast is not None else 0.7 if self.within is None else 0.0
        plain = self._recipe(width, height, sigma, contrast, self.target == "flat")
        return replace(plain, measure=self.measure, order=order)

    def controlled(
        self, recipe: Recipe, values: np.ndarray, usable: np.ndarray | None, why: str, session: Session
    ) -> Recipe:
        """With the sigma of `amount` (MJH17 section 4.4)."""
        if self.amount is None:
            return recipe
        if self.sigma is not None:
            raise ParameterError(f"amount={self.amount:g}: sigma={self.sigma:g} says it already")
        palette = Palette(session.device, values, usable, recipe, session.budget, why)
        scale = perceived_scale(palette, PALETTE, session.advance, scale_folder())
        sigma = scale.sigma_at(self.amount)
        log.info("%s: amount %g is sigma %.2f px", self.flag(), self.amount, sigma)
        return replace(recipe, sigma=sigma)

    def sigmas(self, width: int, height: int) -> np.ndarray | None:
        """From sigmamap."""
        if self.sigmamap is None:
            return None
        for name, value in (("sigma", self.sigma), ("amount", self.amount)):
            if value is not None:
                raise ParameterError(f"{name}={value:g}: sigmamap says it already")
        return sigmas_of(self.sigmamap, width, height)


@dataclass(frozen=True, kw_only=True)
class PatchMatch(_PatchSynthesis):
    """The photo synthesized anew by PatchMatch alone: the paper's baselines (MJH17 section 5.2).

    The same as --texstationarize without its projection. `tile=xy` is toroidal PatchMatch, `tile=none` the plain one.
    """

    name: ClassVar[str] = "patchmatch"

    contrast: float = param(
        1.0, ge=0, le=1, help="how strongly the histogram is held to the photo's at first; it fades out"
    )

    def recipe(self, width: int, height: int) -> Recipe:
        """MJH17 without stationarity."""
        return self._recipe(width, height, None, self.contrast, False)


def refuse_overwriting(exemplar: Image, *paths: object, **named: object) -> None:
    """Refuse a file of ours that is the photo itself; it is called by its modifier where that is given."""
    for path, said in (*((p, f"{p}") for p in paths), *((p, f"{name}={p}") for name, p in named.items())):
        if isinstance(path, Path) and os.path.realpath(path) == os.path.realpath(exemplar.source):
            raise ParameterError(f"{said} would overwrite the photo")


def tile_image(
    op: Op, exemplar: Image, pixels: np.ndarray, places: np.ndarray, session: Session, *, first: bool = True,
    as_it_was: bool = False,
) -> Image:  # fmt: skip
    """The exemplar's pixels at packed places (y << 16 | x), whole.

    `op.stmap` asks for the places themselves, with the `first` map of a material. What is `as_it_was` keeps the windows
    of the exemplar.
    """
    source = exemplar.first
    size = places.shape[1], places.shape[0]
    spec, st_like = tile_spec(source.spec, op, *size), st_spec(*size)
    if as_it_was:
        for new in (spec, st_like):
            new.x, new.y = source.spec.x, source.spec.y
            new.full_x, new.full_y = source.spec.full_x, source.spec.full_y
            new.full_width, new.full_height = source.spec.full_width, source.spec.full_height
    whole = Window.data(spec)

    def copied(window: Window) -> np.ndarray:
        return pixels[unpack(places[window.inside(whole)])]

    def coordinates(window: Window) -> np.ndarray:
        return source_coordinates(*unpack(places[window.inside(whole)]), source.spec)

    tile = Part(source.name, spec, copied, source.spec.format, ready=True)
    if not first:
        return Image((tile,), exemplar.source)
    st = Part("st", st_like, coordinates, oiio.TypeDesc(oiio.FLOAT), ready=True, exact=True)
    if isinstance(op.stmap, Path):
        write(Image((st,), str(op.stmap)), op.stmap, st.spec.format)
        session.written.add(os.path.realpath(op.stmap))
    say_what_stays(op)
    return Image((tile, st) if op.stmap is True else (tile,), exemplar.source)


def named(image: Image, name: str, facts: dict[str, str]) -> Image:
    """The image, its first part under that name and with these attributes."""

    def mark(spec: oiio.ImageSpec) -> None:
        for attribute, value in {"oiio:subimagename": name, **facts}.items():
            spec.attribute(attribute, value)

    first = replace(image.first.respecced(mark), name=name)
    return Image((first, *image.parts[1:]), image.source)


def source_coordinates(y: np.ndarray, x: np.ndarray, spec: oiio.ImageSpec) -> np.ndarray:
    """Pixel indices in the data window -> (s, t) over the display window, (height, width, 2) float32.

    (0, 0) is the display window's top left corner and (1, 1) its bottom right, as --st_warp has it; pixel centres
    lie half a pixel in.
    """
    s = (x + spec.x - spec.full_x + 0.5) / spec.full_width
    t = (y + spec.y - spec.full_y + 0.5) / spec.full_height
    return np.stack([s, t], axis=-1).astype(np.float32)


def tile_spec(spec: oiio.ImageSpec, op: Op, width: int, height: int) -> oiio.ImageSpec:
    """Of a result that is copied from an image with that spec."""
    new = derived_spec(spec, width, height)
    tiling = op.tiling if isinstance(op, _PatchSynthesis) else getattr(op, "tile", "none")
    if getattr(op, "variants", 1) > 1:
        tiling = "none"  # of itself: it goes on in other tiles
    new.attribute("wrapmodes", ",".join("periodic" if a in tiling.replace("none", "") else "black" for a in "xy"))
    return new


def st_spec(width: int, height: int) -> oiio.ImageSpec:
    """Of a map of source coordinates."""
    spec = oiio.ImageSpec(width, height, 2, oiio.FLOAT)
    spec.channelnames = ("R", "G")
    spec.attribute("oiio:ColorSpace", "data")
    return spec
