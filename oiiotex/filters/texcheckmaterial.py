# SPDX-License-Identifier: Apache-2.0
"""--texcheckmaterial: what a renderer will not like about the maps of a material."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from .. import __version__
from ..core.access import ScanThenMap
from ..core.image import Image
from ..core.op import Kind, Output, Space
from ..core.parameters import Words, image, param
from ..deferred import oiio
from ..errors import ParameterError
from ..exemplar.materials import KINDS_HELP, kinds_of
from ..session import Session

SCHEMA = "oiiotex.materialcheck/1"


def _lines(report: dict[str, Any]) -> Iterator[str]:
    """Findings for people, and how many."""
    for finding in report["findings"]:
        yield f"{finding['level']}: {finding['map']}: {finding['text']}"
    levels = [finding["level"] for finding in report["findings"]]
    yield f"{len(report['maps'])} maps: {levels.count('error')} errors, {levels.count('warning')} warnings"


def _without_hash(spec: oiio.ImageSpec) -> None:
    """Nobody has looked whether it is that of these pixels."""
    spec.erase_attribute("oiio:SHA-1")


@dataclass(frozen=True, kw_only=True)
class CheckMaterial(ScanThenMap):
    """Find what a renderer will not like about the maps of a material; the maps go on as they are.

    Of all maps: sizes that differ, NaN and Inf, a color space that is wrong for what they hold. Of albedo: values that
    no surface has, and baked light: slow drift of lightness, lightness that follows the normals (light from one side)
    or the heights (occlusion). Of normals: vectors that are not of length 1 or point down, a mean that leans, and green
    that points the wrong way (OpenGL up, DirectX down), by the heights where there are any, else because slopes of a
    surface have no curl. Of heights: none at all, and 8 bits. Of other data: values outside of 0 to 1.
    Each finding is printed on a line, and json= keeps them with all measures. An error renders wrong, a warning may;
    with fail=errors, as it is, the run goes to its end and its exit code is 3 where there is an error.
    """

    example: ClassVar[str] = """\
>>> maps = ["roughness.png"]
>>> same = filters.checkmaterial("photo.png", maps=maps, kinds=["color", "data"], json="checks.json")
"""
    name: ClassVar[str] = "checkmaterial"
    space: ClassVar[Space] = Space.ANY
    outputs: ClassVar[tuple[Output, ...]] = (
        Output("map", Kind.PIXELS, "the maps as they came"),
        Output(
            "report", Kind.TABLE, "findings, and measures of every map", asked_by="json", judged_by="fail", lines=_lines
        ),
    )  # fmt: skip

    source: Image = image(help="the map; of n maps of a material, the first")
    maps: tuple[Image, ...] = image((), help="the other maps of the material", count="n")
    n: int = param(1, ge=1, le=16, help="how many maps are looked at together, the last images of the stack")
    kinds: Words | None = param(None, help=KINDS_HELP)
    convention: str = param("opengl", choices=("opengl", "directx"), help="green of normals shall point up or down")
    fail: str = param("errors", choices=("errors", "warnings", "none"), help="what makes the exit code 3")
    json: Path | None = param(None, help="findings and measures go to this file")

    def result_count(self) -> int:
        """As many as there are maps."""
        return 1 + len(self.maps)

    def compute(self, session: Session) -> tuple[dict[str, Any], ...]:
        """The maps, the first with what was found of all."""
        images = (self.source, *self.maps)
        if self.n != len(images):
            raise ParameterError(f"n={self.n}: there are {len(images)} maps")
        kinds = kinds_of(self.kinds, len(images), data=False)
        first, *others = ({"map": one.first.respecced(_without_hash)} for one in images)
        return ({**first, "report": lambda: self._report(images, kinds, session)}, *others)

    def _report(self, images: tuple[Image, ...], kinds: list[str], session: Session) -> dict[str, Any]:
        from ..capture.material_checks import check_material, document  # what a line alone says needs none of it

        found = document(*check_material(images, kinds, self.convention, session.resources, session.progress))
        failing = {"errors": ("error",), "warnings": ("error", "warning"), "none": ()}[self.fail]
        failed = [f"{one['map']}: {one['text']}" for one in found["findings"] if one["level"] in failing]
        return {"schema": SCHEMA, "version": __version__, **found, "passed": not failed, "failed": failed}
