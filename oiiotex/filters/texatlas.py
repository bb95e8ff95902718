# SPDX-License-Identifier: Apache-2.0
"""--texatlas: the texture of a photo on the surface of a mesh."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from ..engine.core.access import Whole
from ..engine.core.image import Part, channels_of
from ..engine.core.op import Kind, Output, Plan
from ..engine.core.parameters import Size, param
from ..engine.core.source_map import ST, require_addressable
from ..engine.deferred import np
from ..engine.errors import ImageError, ParameterError, present
from ..engine.session import Session
from ..engine.session.facts import Facts
from ..synthesis.exemplar.exemplar_op import MaterialOp

if TYPE_CHECKING:
    from ..surfaces.atlas.mesh import Mesh

_LARGEST = 65536  # px of all tiles together
_FINEST, _COARSEST = 0.5, 2.0  # width of a pixel of the photo, in pixels of the atlas
_PIXEL_BYTES, _PHOTO_BYTES, _MAP_BYTES = 120, 200, 40  # peak, per pixel of: atlas, photo, further map


@dataclass(frozen=True, kw_only=True)
class Atlas(MaterialOp, Whole):
    """Create a texture for a mesh, continuous across the borders of its UV charts.

    It can cover a mesh with the dominant texture of a photo, as in LDR09 figure 7 (Lu, Dorsey, Rushmeier, Dominant
    Texture and Diffusion Distance Manifolds, 2009). A mask from `dominant` keeps objects and stains of the photo off
    the mesh. Pixels of the charts are synthesized from coarse to fine (Lefebvre & Hoppe, Appearance-space texture
    synthesis, SIGGRAPH 2006, section 5), each from its neighbors on the surface, which are rotated and scaled across
    shared edges.

    The texture is oriented along the u axis of the charts, smoothed over the surface. The texture has the same scale
    everywhere, regardless of the scale of each chart. All maps of a material are synthesized together
    (kinds=color,data,normal), and tangent-space normals rotate with the texture. Gutters of 8 px continue the
    texture beyond the border of each chart. A mesh without UVs is unwrapped by xatlas: render the result on the mesh
    that obj=FILE.obj writes. Requires `pip install oiiotex[atlas]`.
    """

    example: ClassVar[str] = '>>> atlas = filters.atlas("photo.png", mesh="statue.obj", size=(1024, 1024))'
    name: ClassVar[str] = "atlas"
    outputs: ClassVar[tuple[Output, ...]] = (
        Output("atlas", Kind.PIXELS, "Atlas of pixels copied from the photo, one for each map. Normals are rotated."),
        ST,
        Output("obj", Kind.MESH, "Mesh with the UV charts of the atlas.", asked_by="obj"),
    )

    mesh: Path | None = param(
        None,
        unset="none; a mesh is required",
        example="chair.obj",
        help="Mesh to texture: OBJ, PLY, glTF, GLB, STL or OFF. UVs must lie within 0 to 1 without overlaps;"
        " a mesh without UVs is unwrapped.",
    )
    size: Size | None = param(
        None, ge=16, le=16384, unit="px", unset="the exemplar's size", help="Size of the result; with udim, of a tile."
    )
    udim: Size | None = param(
        None,
        ge=1,
        le=10,
        example="3x2",
        help="Columns x rows of the UDIM tiles of the mesh, starting at 1001. The result contains all tiles;"
        ' -o:udim=3x2 "albedo.<UDIM>.exr" writes a file for each.',
    )
    scale: float | None = param(
        None, ge=1e-9, unset="a pixel of the photo is a pixel of the atlas", example="0.5",
        help="Width of the photo on the surface, in units of the mesh.",
    )  # fmt: skip
    obj: Path | None = param(
        None, example="unwrapped.obj", help="File (.obj) for the mesh with the UV charts of the result."
    )
    normals: str = param(
        "opengl", choices=("opengl", "directx"), advanced=True,
        help="Green channel of normal maps. opengl: up; directx: down.",
    )  # fmt: skip

    def plan(self, facts: Facts) -> Plan:
        """The mesh, the size of the atlas, and that of a pixel of the photo on the surface."""
        from ..surfaces.atlas.mesh import read_mesh  # trimesh and its like are slow to import

        if self.mesh is None:
            raise ParameterError("requires mesh=FILE, the mesh to texture")
        if self.obj is not None and self.obj.suffix.lower() != ".obj":
            raise ParameterError(parameter="obj", value=str(self.obj), expected="a file that ends in .obj")
        photo = self.exemplar.first.spec
        tile, tiles = self.size or Size(photo.width, photo.height), self.udim or Size(1, 1)
        size = Size(tile.width * tiles.width, tile.height * tiles.height)
        if max(size) > _LARGEST:
            raise ParameterError(
                f"an atlas of {size} exceeds {_LARGEST} px", parameter="udim", value=tiles, hint="reduce size or udim"
            )
        require_addressable((photo.height, photo.width))
        need = size.width * size.height * _PIXEL_BYTES
        need += photo.width * photo.height * (_PHOTO_BYTES + len(self.maps) * _MAP_BYTES)
        facts.require(need, f"an atlas of {size}", "reduce size")
        mesh = read_mesh(self.mesh, *size, tiles)
        unit = self._unit(mesh, size, photo.width)
        self.require_readable(facts)
        return Plan(work=(mesh, size, tiles, unit))

    def make(self, plan: Plan, session: Session) -> dict[str, Any] | tuple[dict[str, Any], ...]:
        """The atlas and its source coordinates; a tuple of such mappings for several maps."""
        from ..surfaces.atlas.charts import Frames
        from ..surfaces.atlas.normals import turned, turns
        from ..surfaces.atlas.synthesis import stack, synthesize

        resources, progress = session.resources, session.progress
        mesh, size, tiles, unit = plan.work
        seen = self.read(resources)
        with resources.stats.time("directions"):
            fine = mesh.refined()
            frames = Frames.of(fine, unit)
        with resources.stats.time("synthesis"):
            try:
                levels = stack(np.ascontiguousarray(seen.values), seen.usable)
            except ImageError as error:
                missing = f"expected one free of {seen.why or 'the border'}"
                raise ImageError(f"{self.exemplar.source}: {error}: {missing}") from error
            source, face = synthesize(
                fine, frames, size, levels, self.seed, present(self.mesh).name, resources, progress.advance
            )

        def copied(one: Part, kind: str) -> dict[str, Any]:
            parts = source.parts("atlas", one)
            if kind == "normal":
                encoded = bool(one.pixels()[..., list(channels_of(one.spec).color)].min() >= 0)
                turn = turns(fine, frames)[face]
                parts["atlas"] = turned(parts["atlas"], turn, encoded, self.normals == "opengl")
            return parts

        first, *others = self.of_all([image.first for image in self.all_maps()], copied)
        first["obj"] = lambda: mesh.obj(tiles)
        return (first, *others) if others else first

    def _unit(self, mesh: Mesh, size: Size, photo_width: int) -> float:
        """Width of a pixel of the photo on the surface, in units of the mesh; logs the distortion of the charts."""
        solid, flat = mesh.areas()
        texel = (solid.sum() / (flat.sum() * size.width * size.height)) ** 0.5
        unit = texel if self.scale is None else self.scale / photo_width
        if not _FINEST <= unit / texel <= _COARSEST:
            raise ParameterError(
                f"makes a pixel of the photo {unit / texel:.3g} pixels of the {size} atlas wide",
                parameter="scale", value=f"{self.scale:g}", expected=f"{_FINEST:g} to {_COARSEST:g} pixels",
                hint=f"use a scale near {texel * photo_width:.3g}, or change the size of the atlas or of the photo",
            )  # fmt: skip
        stretch = np.sort(flat / solid)
        low, high = stretch[[len(stretch) // 20, -1 - len(stretch) // 20]]
        charts = f"{mesh.chart.max() + 1} charts{' by xatlas' if mesh.unwrapped else ''}"
        text = "%s cover %.0f %% of the atlas; triangle areas vary by a factor of %.3g"
        self.inform(text, charts, 100 * flat.sum(), high / low)
        return float(unit)
