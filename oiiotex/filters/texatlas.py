# SPDX-License-Identifier: Apache-2.0
"""--texatlas: the texture of a photo on the surface of a mesh."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from ..core.access import Whole
from ..core.image import Part, channels_of
from ..core.op import Kind, Output
from ..core.parameters import Size, param
from ..core.source_map import COPIED, ST, require_addressable
from ..deferred import np
from ..errors import ImageError, ParameterError
from ..exemplar.exemplar_op import MaterialOp
from ..session import Session

if TYPE_CHECKING:
    from ..atlas.mesh import Mesh

_LARGEST = 65536  # px of all tiles together
_FINEST, _COARSEST = 0.5, 2.0  # px of the atlas that a pixel of the photo is wide
_PIXEL_BYTES, _PHOTO_BYTES, _MAP_BYTES = 120, 200, 40  # at the widest: for each pixel of atlas, photo, further map


@dataclass(frozen=True, kw_only=True)
class Atlas(MaterialOp, Whole):
    """Make a texture for a 3-D object, that runs on over its surface where its charts end.

    Dominant texture on objects is figure 7 of LDR09 (Lu, Dorsey, Rushmeier, Dominant Texture and Diffusion Distance
    Manifolds, 2009): a mask of the dominant texture (`dominant`) keeps the photo's other things off the object. The
    pixels of the mesh's charts are synthesized from coarse to fine (Lefebvre & Hoppe, Appearance-space texture
    synthesis, SIGGRAPH 2006, section 5), each beside those that are its neighbors on the surface: through shared
    edges, turned and scaled. Directions follow the charts' u, evened out over the surface; texture has one size
    everywhere, whatever the charts' own. All maps of a material are made together (n=3:kinds=color,data,normal), and
    tangent-space normals turn with the texture. Gutters of 8 px show what lies beyond. A mesh without UVs gets charts
    by xatlas: unwrapped=FILE.obj is the mesh that goes with the result. Needs `pip install oiiotex[atlas]`.
    """

    example: ClassVar[str] = '>>> atlas = filters.atlas("photo.png", mesh="statue.obj", size=(1024, 1024))'
    name: ClassVar[str] = "atlas"
    outputs: ClassVar[tuple[Output, ...]] = (
        Output("atlas", Kind.PIXELS, f"{COPIED}; of n maps n images, in their order; normals are turned"),
        ST,
        Output("mesh", Kind.MESH, "the mesh with the charts that the result is for", asked_by="unwrapped"),
    )

    mesh: Path | None = param(
        None,
        help="needed: OBJ, PLY, glTF, GLB, STL or OFF; its own UVs, in 0 to 1, without overlaps, else made ones",
    )
    size: Size | None = param(
        None, ge=16, le=16384, unit="px", help="of the result, with udim of a tile; the exemplar's own when left out"
    )
    udim: Size | None = param(
        None,
        ge=1,
        le=10,
        help="columns x rows of UDIM tiles in which the mesh's UVs lie, from 1001 on; the result shows all of them,"
        ' and -o:udim=3x2 "albedo.<UDIM>.exr" writes them apart',
    )
    scale: float | None = param(
        None, ge=1e-9, help="how wide the photo is on the surface, in the mesh's units; pixel for pixel when left out"
    )
    unwrapped: Path | None = param(None, help="the mesh with the charts of the result goes to this file (.obj)")
    convention: str = param(
        "opengl", choices=("opengl", "directx"), help="where green of maps of kind normal points: up (opengl) or down"
    )

    def compute(self, session: Session) -> dict[str, Any] | tuple[dict[str, Any], ...]:
        """The atlas, and where its pixels come from; of several maps one such mapping each."""
        from ..atlas.charts import Frames  # trimesh and its like are slow to import
        from ..atlas.mesh import read_mesh
        from ..atlas.normals import turned, turns
        from ..atlas.synthesis import stack, synthesize

        resources, progress = session.resources, session.progress
        if self.mesh is None:
            raise ParameterError("mesh=FILE is missing: the object that is textured")
        if self.unwrapped is not None and self.unwrapped.suffix.lower() != ".obj":
            raise ParameterError(parameter="unwrapped", value=str(self.unwrapped), expected="a file that ends in .obj")
        maps = self.all_maps()
        photo = self.exemplar.first.spec
        tile, tiles = self.size or Size(photo.width, photo.height), self.udim or Size(1, 1)
        size = Size(tile.width * tiles.width, tile.height * tiles.height)
        if max(size) > _LARGEST:
            raise ParameterError(f"udim={tiles}: an atlas of {size} is wider or higher than {_LARGEST} px")
        require_addressable((photo.height, photo.width))
        need = size.width * size.height * _PIXEL_BYTES
        need += photo.width * photo.height * (_PHOTO_BYTES + len(self.maps) * _MAP_BYTES)
        resources.require(need, f"an atlas of {size}", "make size smaller")
        with resources.stats.time("mesh"):
            mesh = read_mesh(self.mesh, *size, tiles)
        unit = self._unit(mesh, size, photo.width)
        seen = self.read(resources)
        with resources.stats.time("directions"):
            fine = mesh.refined()
            frames = Frames.of(fine, unit)
        with resources.stats.time("synthesis"):
            try:
                levels = stack(np.ascontiguousarray(seen.values), seen.usable)
            except ImageError as error:
                raise ImageError(f"{self.exemplar.source}: {error}, without {seen.why or 'its border'}") from error
            source, face = synthesize(
                fine, frames, size, levels, self.seed, self.mesh.name, resources.spread, progress.advance
            )
        self.say_what_stays()

        def copied(one: Part, kind: str) -> dict[str, Any]:
            parts = source.parts("atlas", one)
            if kind == "normal":
                encoded = bool(one.pixels()[..., list(channels_of(one.spec).color)].min() >= 0)
                turn = turns(fine, frames)[face]
                parts["atlas"] = turned(parts["atlas"], turn, encoded, self.convention == "opengl")
            return parts

        first, *others = self.of_all([image.first for image in maps], copied)
        first["mesh"] = lambda: mesh.obj(tiles)
        return (first, *others) if others else first

    def _unit(self, mesh: Mesh, size: Size, photo_width: int) -> float:
        """How wide a pixel of the photo is on the surface; says what charts do to areas."""
        solid, flat = mesh.areas()
        texel = (solid.sum() / (flat.sum() * size.width * size.height)) ** 0.5
        unit = texel if self.scale is None else self.scale / photo_width
        if not _FINEST <= unit / texel <= _COARSEST:
            raise ParameterError(
                f"scale={self.scale:g}: a pixel of the photo is {unit / texel:.3g} pixels of {size} on this mesh;"
                f" expected {_FINEST:g} to {_COARSEST:g}: a scale about {texel * photo_width:.3g}, another size, or a"
                " smaller or larger photo"
            )
        stretch = np.sort(flat / solid)
        low, high = stretch[[len(stretch) // 20, -1 - len(stretch) // 20]]
        charts = f"{mesh.chart.max() + 1} charts{' by xatlas' if mesh.unwrapped else ''}"
        text = "%s on %.0f %% of the atlas; areas of triangles are stretched by a factor of up to %.3g"
        self.inform(text, charts, 100 * flat.sum(), high / low)
        return float(unit)
