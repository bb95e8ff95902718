# SPDX-License-Identifier: Apache-2.0
"""--texjoin: an image from crops that were rendered separately."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, ClassVar

from ..engine.core.access import ScanThenMap
from ..engine.core.attributes import PLANE
from ..engine.core.demand import bands
from ..engine.core.image import Image, Part, derived_spec, dtype_of
from ..engine.core.op import Kind, Output, Plan, Space
from ..engine.core.parameters import image
from ..engine.core.window import Window
from ..engine.deferred import np
from ..engine.errors import ImageError
from ..engine.io.formats import tile_of
from ..engine.session import Session
from ..engine.session.facts import Facts

# parameters in which crops of one image may differ
_APART = ("window", "resume", "graph", "st", "report", "fail")


@dataclass(frozen=True, kw_only=True)
class Join(ScanThenMap):
    """Join crops of an image that were rendered separately, as on a farm.

    Takes all images on the stack, in any order. They must be crops of one display window, as `synth` renders them with
    `size` and `window`, and must cover it. They must have the same channels, pixel type and parts, and must be equal
    where they overlap. The result has the same pixels as a single run.
    """

    example: ClassVar[str] = """\
>>> import OpenImageIO as oiio
>>> halves = [filters.flatten("photo.png", roi=oiio.ROI(x, x + 48, 0, 96)) for x in (0, 48)]  # of 96 x 96 px
>>> joined = filters.join(*halves)
"""
    name: ClassVar[str] = "join"
    copies: ClassVar[bool] = True
    space: ClassVar[Space] = Space.ANY
    outputs: ClassVar[tuple[Output, ...]] = (Output("joined", Kind.PIXELS, "Whole image, with all parts."),)

    shares: tuple[Image, ...] = image(help="Crops to join, in any order.")

    @classmethod
    def arity(cls, values: dict[str, Any], depth: int) -> int:
        """All images on the stack."""
        return max(1, depth)

    def plan(self, facts: Facts) -> Plan:
        """The whole image."""
        first = self.shares[0]
        for share in self.shares[1:]:
            _require_alike(share, first)
        joined = [_Joined(self.shares, n) for n in range(len(first.parts))]
        return Plan(Image(tuple(one.part() for one in joined), first.source), joined)

    def make(self, plan: Plan, session: Session) -> Image:
        """The whole image; apart from overlaps, pixels are read on request."""
        for joined in plan.work:
            joined.require_equal()
        image: Image = plan.results
        return image


def _require_alike(share: Image, first: Image) -> None:
    """Raise ImageError if a crop belongs to another image."""

    def differ(aspect: str, mine: object, wanted: object) -> None:
        if mine != wanted:
            raise ImageError(
                f"has {aspect} {mine}: expected {wanted}, as {first.source}; all must be crops of one image",
                subject=share.source,
            )

    differ("parts", ",".join(p.name for p in share.parts), ",".join(p.name for p in first.parts))
    for part, wanted in zip(share.parts, first.parts, strict=True):
        differ("channels", ",".join(part.spec.channelnames), ",".join(wanted.spec.channelnames))
        differ("pixel type", str(part.spec.format), str(wanted.spec.format))
        differ("display window", str(Window.display(part.spec)), str(Window.display(wanted.spec)))
    mine, wanted_words = _parameters(share), _parameters(first)
    for name in mine.keys() & wanted_words.keys():
        differ("parameter", f"{name}={mine[name]}", f"{name}={wanted_words[name]}")
    if len({one.first.spec.get_string_attribute(PLANE) for one in (share, first)}) > 1:
        raise ImageError(
            f"{share.source} and {first.source} are crops of different textures: the graph, the seed or another"
            " setting differs"
        )


def _parameters(share: Image) -> dict[str, str]:
    """Parameters recorded in a crop, without those in which crops may differ."""
    words = share.first.spec.get_string_attribute("oiiotex:parameters").split(":")
    given = dict(word.partition("=")[::2] for word in words if "=" in word)
    return {name: value for name, value in given.items() if name not in _APART}


class _Joined:
    """One image part of all crops."""

    def __init__(self, shares: Sequence[Image], number: int):
        self._shares = shares
        self._parts = [share.parts[number] for share in shares]
        windows = [part.window for part in self._parts]
        self._whole = Window.display(self._parts[0].spec)
        for window in windows:
            self._whole |= window
        gap = first_gap(self._whole, windows)
        if gap is not None:
            raise ImageError(f"{gap} of {self._whole} is not covered by the {len(shares)} images")

    def require_equal(self) -> None:
        """Raise ImageError if crops differ where they overlap."""
        for n, part in enumerate(self._parts):
            for m in range(n):
                self._require_equal(m, n, part.window & self._parts[m].window)

    def _require_equal(self, m: int, n: int, shared: Window) -> None:
        """Raise ImageError if two crops differ where they overlap."""
        if shared.empty:
            return
        a, b = self._parts[m], self._parts[n]
        for band in shared.cells(shared.width, next(iter(bands(replace(a, spec=shared.apply_to(a.spec))))).height):
            unlike = (a.read(band).view(np.uint8) != b.read(band).view(np.uint8)).any(-1)
            if unlike.any():
                y, x = (int(at[0]) for at in np.nonzero(unlike))
                names = f"{self._shares[m].source} and {self._shares[n].source}"
                raise ImageError(
                    f"{names} differ where they overlap ({shared}), first at {band.left + x},{band.top + y}"
                )

    def part(self) -> Part:
        """The joined part."""
        first, whole, dtype = self._parts[0], self._whole, dtype_of(self._parts[0].spec)

        def fetch(window: Window) -> np.ndarray:
            out = np.empty((window.height, window.width, first.spec.nchannels), dtype)
            for part in self._parts:
                shared = window & part.window
                if not shared.empty:
                    out[shared.inside(window)] = part.read(shared)
            return out

        spec = whole.apply_to(derived_spec(first.spec))
        spec.tile_width, spec.tile_height, spec.tile_depth = tile_of(first.spec)
        spec.erase_attribute("oiiotex:window")
        ready = all(part.ready for part in self._parts)
        return replace(first, spec=spec, fetch=fetch, ready=ready, levels=())


def first_gap(whole: Window, windows: Sequence[Window]) -> Window | None:
    """The topmost part of a window that no other window covers; None if all is covered."""
    xs = sorted({whole.left, whole.right, *(x for w in windows for x in (w.left, w.right))})
    ys = sorted({whole.top, whole.bottom, *(y for w in windows for y in (w.top, w.bottom))})
    covered = np.zeros((len(ys) - 1, len(xs) - 1), bool)
    for w in windows:
        covered[ys.index(w.top) : ys.index(w.bottom), xs.index(w.left) : xs.index(w.right)] = True
    if covered.all():
        return None
    rows, columns = list(pairwise(ys)), list(pairwise(xs))
    row = int(np.flatnonzero(~covered.all(1))[0])
    begin = int(np.flatnonzero(~covered[row])[0])
    end = begin + int(np.argmax(np.append(covered[row, begin:], True)))
    last = row + int(np.argmax(np.append(covered[row:, begin:end].any(1), True)))
    return Window(columns[begin][0], rows[row][0], columns[end - 1][1], rows[last - 1][1])
