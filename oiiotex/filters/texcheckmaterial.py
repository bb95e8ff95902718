# SPDX-License-Identifier: Apache-2.0
"""--texcheckmaterial: validation of the maps of a material."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from .. import __version__
from ..engine.core.access import ScanThenMap
from ..engine.core.image import Image
from ..engine.core.op import Kind, Output, Plan, Space
from ..engine.core.parameters import Words, image, nearest, param
from ..engine.core.tiling import TILED, retiled, tiling_of
from ..engine.errors import ParameterError
from ..engine.session import Session
from ..engine.session.facts import Facts
from ..synthesis.exemplar.materials import KINDS_HELP, kinds_of
from ..synthesis.quality.limit import Limit

SCHEMA = "oiiotex.materialcheck/1"
_LEVELS = {"errors": "error", "warnings": "warning"}  # of findings, by the name of their number


def _lines(report: dict[str, Any]) -> Iterator[str]:
    """A line for each finding and each good tile, and the totals."""
    from ..surfaces.capture.tile_checks import OF_TILES

    for finding in report["findings"]:
        yield f"{finding['level']}: {finding['map']}: {finding['text']}"
    faulty = {finding["map"] for finding in report["findings"] if finding["check"] in OF_TILES}
    for one in report["maps"]:
        if "seam" in one["measures"] and one["name"] not in faulty:
            unseen = ", and it repeats without notice" if "waves" in one["measures"] else ""
            yield f"good: {one['name']}: no seam is visible (jump {one['measures']['seam']:.2f}){unseen}"
    levels = [finding["level"] for finding in report["findings"]]
    yield f"{len(report['maps'])} maps: {levels.count('error')} errors, {levels.count('warning')} warnings"


@dataclass(frozen=True, kw_only=True)
class CheckMaterial(ScanThenMap):
    """Check the maps of a material for problems in rendering, and pass them on unchanged.

    All maps: different sizes, NaN and Inf, a color space that conflicts with the kind of the map.
    Albedo: values that no real surface has, and baked lighting: low-frequency variation of lightness, or lightness
    that correlates with the normals (directional light) or with the heights (occlusion).
    Normals: vectors that are not of unit length or point down, a tilted mean, and a green channel of the wrong sign
    (OpenGL up, DirectX down). The sign is tested against the heights, or without heights by the curl of the slopes.
    Heights: a constant map, and 8-bit files. Other data: values outside of 0 to 1.
    Tiles (see tiled): seams, borders that are mirrored or softened by a cross-fade, slow waves and salient spots that
    show where a tile repeats. Maps that do not lie on the first one.

    The maps may come from any program: no photo is needed. Each finding is printed as a line; facts= writes them to a
    file with all measures. Errors render incorrectly, warnings possibly. The run always completes; its exit code is 3
    if there is an error (see fail).
    """

    example: ClassVar[str] = """\
>>> maps = ["roughness.png"]
>>> same = filters.checkmaterial("photo.png", maps=maps, kinds=["color", "data"], facts="checks.json")
"""
    name: ClassVar[str] = "checkmaterial"
    space: ClassVar[Space] = Space.ANY
    outputs: ClassVar[tuple[Output, ...]] = (
        Output("map", Kind.PIXELS, "Maps, unchanged."),
        Output(
            "facts", Kind.TABLE, "Findings, and measures of each map.",
            asked_by="facts", judged_by="fail", lines=_lines,
        ),
    )  # fmt: skip

    source: Image = image(help="Map to check; of the maps of a material, the first.")
    maps: tuple[Image, ...] = image((), help="Other maps of the material.", count="kinds")
    kinds: Words | None = param(None, help=KINDS_HELP, unset="one map: color", example="color,normal")
    normals: str = param(
        "opengl", choices=("opengl", "directx"), help="Expected green channel of normals. opengl: up; directx: down."
    )
    fail: Words = param(
        Words(("errors>0",)), example="errors>0,warnings>0,seam>1.3",
        help="Conditions that count as failure, on the number of errors or warnings and on measures of any map, such"
        " as seam>1.3. If one is true, the exit code is 3. none: it is 0.",
    )  # fmt: skip
    tiled: str | None = TILED
    facts: Path | None = param(None, example="report.json", help="File for findings and measures.")

    def result_count(self) -> int:
        """The number of maps."""
        return 1 + len(self.maps)

    def plan(self, facts: Facts) -> Plan:
        """The maps."""
        images = (self.source, *self.maps)
        kinds, limits = kinds_of(self.kinds, len(images), data=False), _limits(self.fail)
        # without the hash, which was not verified against these pixels
        maps = [one.first.respecced(lambda spec: spec.erase_attribute("oiio:SHA-1")) for one in images]
        if self.tiled is not None:
            maps = [retiled(one, self.tiled) for one in maps]
        return Plan(tuple({"map": one} for one in maps), (images, kinds, limits))

    def make(self, plan: Plan, session: Session) -> tuple[dict[str, Any], ...]:
        """The maps; the first has the report on all of them."""
        (first, *others), (images, kinds, limits) = plan.results, plan.work
        return ({**first, "facts": lambda: self._report(images, kinds, limits, session)}, *others)

    def _report(
        self, images: tuple[Image, ...], kinds: list[str], limits: tuple[Limit, ...], session: Session
    ) -> dict[str, Any]:
        from ..surfaces.capture.material_checks import check_material, document  # not needed to parse the command line
        from ..surfaces.capture.tile_checks import finished_findings

        axes = self.tiled or "".join(a for a in "xy" if any(a in tiling_of(one.first.spec) for one in images)) or "none"
        maps, findings = check_material(images, kinds, self.normals, session.resources, session.progress)
        broken = {fault.map for fault in findings if fault.check == "broken"}
        whole = [n for n, one in enumerate(images) if one.source not in broken]
        findings += finished_findings(
            [images[n] for n in whole], [kinds[n] for n in whole], [maps[n]["measures"] for n in whole], axes,
            session.resources,
        )  # fmt: skip
        found = document(maps, findings)
        failed = [text for limit in limits for text in _beyond(limit, found)]
        return {"schema": SCHEMA, "version": __version__, **found, "passed": not failed, "failed": failed}


def _limits(conditions: Words) -> tuple[Limit, ...]:
    """Conditions on numbers of findings and on measures of a finished map."""
    from ..surfaces.capture.tile_checks import MEASURES

    limits = tuple(Limit.read(text, "fail") for text in conditions if text != "none")
    names = (*_LEVELS, *MEASURES)
    for measure in (limit.measure for limit in limits if limit.measure not in names):
        problem = f"unknown measure '{measure}'{nearest(measure, names)}"
        raise ParameterError(problem, parameter="fail", value=measure, expected=f"one of {', '.join(names)}")
    return limits


def _beyond(limit: Limit, found: dict[str, Any]) -> Iterator[str]:
    """The findings and maps beyond a limit, as text; it is one to measure nothing."""
    if limit.measure in _LEVELS:
        texts = [f"{one['map']}: {one['text']}" for one in found["findings"] if one["level"] == _LEVELS[limit.measure]]
        yield from texts if limit.passed_by(len(texts)) else ()
        return
    values = {one["name"]: one["measures"][limit.measure] for one in found["maps"] if limit.measure in one["measures"]}
    for name, value in values.items():
        if limit.passed_by(value):
            yield f"{name}: {limit.measure} is {value:.4g}: fail={limit}"
    if not values:
        yield f"{limit.measure} is not measured: fail={limit}"
