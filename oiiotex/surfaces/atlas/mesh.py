# SPDX-License-Identifier: Apache-2.0
"""A triangle mesh with charts: read, welded and validated for synthesis."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ...engine.deferred import np
from ...engine.errors import ImageError, ParameterError, reason_of

_INSTALL = "pip install 'oiiotex[atlas]'"
_FLAT = 1e-12  # of the squared extent of the mesh, or of the unit square: a smaller area is degenerate
_FINE = 5000  # triangles: a mesh with fewer is subdivided
_INSIDE = 1e-6  # tolerance of UVs beyond a tile
_MOST_TILES = 10  # columns in the UDIM numbering
_PADDING = 8  # px between charts of xatlas


@dataclass(frozen=True, eq=False)
class Mesh:
    """A triangulated surface, flattened into charts.

    Attributes
    ----------
    points : (vertices, 3) float64
        Vertices without duplicates.
    faces : (faces, 3) int64
        Indices of vertices, counterclockwise as seen from outside.
    across : (faces, 3) int64
        Face across the edge opposite to each corner; -1 at a boundary.
    uv : (faces, 3, 2) float64
        UVs of each corner of each face, 0 to 1, v upwards.
    chart : (faces,) int64
        Index of the chart, from 0.
    unwrapped : bool
        Whether the charts are made by xatlas.
    """

    points: np.ndarray
    faces: np.ndarray
    across: np.ndarray
    uv: np.ndarray
    chart: np.ndarray
    unwrapped: bool

    @property
    def corners(self) -> np.ndarray:
        """(faces, 3, 3) float64."""
        return self.points[self.faces]

    def areas(self) -> tuple[np.ndarray, np.ndarray]:
        """Areas of all faces on the surface, and in the atlas as proportions of the unit square."""
        flat = np.concatenate([self.uv, np.zeros_like(self.uv[..., :1])], -1)
        return _areas(self.corners), _areas(flat)

    def refined(self) -> Mesh:
        """The same surface, subdivided while it has few triangles, since each triangle has one direction."""
        mesh = self
        while 4 * len(mesh.faces) <= _FINE:
            ends = np.sort(np.stack([np.roll(mesh.faces, -1, 1), np.roll(mesh.faces, -2, 1)], -1), -1)
            edges, middle = np.unique(ends.reshape(-1, 2), axis=0, return_inverse=True)
            points = np.concatenate([mesh.points, mesh.points[edges].mean(1)])
            faces = _quarter(*(middle.reshape(-1, 3) + len(mesh.points)).T, *mesh.faces.T)
            corners = np.moveaxis(mesh.uv, 1, 0)
            halves = [(corners[(n + 1) % 3] + corners[(n + 2) % 3]) / 2 for n in range(3)]
            uv, chart = _quarter(*halves, *corners), np.repeat(mesh.chart, 4)
            mesh = Mesh(points, faces, _neighbors(faces, "the mesh"), uv, chart, mesh.unwrapped)
        return mesh

    def obj(self, tiles: tuple[int, int] = (1, 1)) -> str:
        """Contents of a Wavefront OBJ with the charts, spread over UDIM tiles, (columns, rows)."""
        lines = [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in self.points]
        lines += [f"vt {u:.9g} {v:.9g}" for u, v in (self.uv * tiles).reshape(-1, 2)]
        corners = np.arange(1, self.faces.size + 1).reshape(-1, 3)
        for face, uv in zip(self.faces + 1, corners, strict=True):
            lines.append("f " + " ".join(f"{point}/{at}" for point, at in zip(face, uv, strict=True)))
        return "\n".join(lines) + "\n"


def read_mesh(path: Path, width: int, height: int, tiles: tuple[int, int] = (1, 1)) -> Mesh:
    """Read a mesh in any format of trimesh; without UVs it is unwrapped by xatlas.

    Parameters
    ----------
    path : Path
        OBJ, PLY, glTF, GLB, STL, OFF, ...
    width, height : int
        Size of the atlas for which the mesh is unwrapped.
    tiles : (columns, rows)
        UDIM tiles of its UVs; together they are the unit square of the result.

    Raises
    ------
    ParameterError
        A library is missing.
    ImageError
        The file cannot be read, is empty, or is not a valid surface with charts.
    """
    points, faces, uv = _loaded(path)
    name = path.name
    if not len(faces):
        raise ImageError(f"{name} has no triangles")
    if faces.min() < 0 or faces.max() >= len(points):
        raise ImageError(f"{name} has triangles with invalid indices: expected vertices 0 to {len(points) - 1}")
    used = np.unique(faces)
    broken = np.count_nonzero(~np.isfinite(points[used]).all(-1))
    if broken:
        raise ImageError(f"{name} has {broken} vertices with NaN or Inf")
    extent = np.ptp(points[used], axis=0).max()
    # vertices are split at UV seams: equal places are welded
    points, welded = np.unique(points, axis=0, return_inverse=True)
    corners = welded.reshape(-1)[faces]
    _require_area(_areas(points[corners]), _FLAT * extent**2, f"{name} has {{}} degenerate triangles, without area")
    across = _neighbors(corners, name)
    unwrapped = uv is None
    if unwrapped and tuple(tiles) != (1, 1):
        problem = f"requires UVs, which {name} does not have"
        raise ParameterError(problem, parameter="udim", value=f"{tiles[0]}x{tiles[1]}", hint="unwrap it, or omit udim")
    flat = _unwrapped(points, corners, width, height) if uv is None else uv[faces]
    _check_charts(flat, name, tiles)
    flat = flat / tiles
    return Mesh(points, corners, across, flat, _charts(corners, across, flat), unwrapped)


def _quarter(
    at_a: np.ndarray, at_b: np.ndarray, at_c: np.ndarray, a: np.ndarray, b: np.ndarray, c: np.ndarray
) -> np.ndarray:
    """Four triangles per triangle, from its corners and the midpoints opposite to them: (4 n, 3, ...)."""
    four = [(a, at_c, at_b), (at_c, b, at_a), (at_b, at_a, c), (at_a, at_b, at_c)]
    return np.stack([np.stack(one, 1) for one in four], 1).reshape(-1, 3, *a.shape[1:])


def _loaded(path: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
    """Vertices, faces and UVs of a file, with all its objects combined."""
    try:
        import trimesh
    except ImportError as error:
        problem = f"requires trimesh: {_INSTALL}"
        raise ParameterError(problem, parameter="mesh", value=path.name) from error

    class RegularFiles(trimesh.resolvers.FilePathResolver):
        """Reads external buffers of a glTF from regular files only: reading from a pipe would block."""

        def get(self, name: str) -> bytes:
            beside = Path(self.parent, name)
            if beside.exists() and not beside.is_file():
                raise ValueError(f"{name} is not a regular file")
            return bytes(super().get(name))

    # groups by material would split the surface of an OBJ; materials are ignored
    more: dict[str, Any] = {"group_material": False, "split_objects": False, "skip_materials": True}
    try:
        scene = trimesh.load_scene(
            path, process=False, resolver=RegularFiles(str(path)), **(more if path.suffix.lower() == ".obj" else {})
        )
        placed = [(scene.graph[node], scene.geometry) for node in scene.graph.nodes_geometry]
        objects = [(matrix, geometry[name]) for (matrix, name), geometry in placed]
        meshes = [(matrix, one) for matrix, one in objects if hasattr(one, "faces") and len(one.faces)]
    except Exception as error:  # readers of a dozen formats raise different exceptions
        raise ImageError(f"{path} cannot be read as a mesh: {reason_of(error)}") from error
    points, faces, uvs, count = [], [], [], 0
    for matrix, one in meshes:
        vertices = np.asarray(one.vertices, np.float64)
        if vertices.shape[1:] != (3,):
            raise ImageError(f"{path.name} has vertices of {vertices.shape[-1]} coordinates: expected 3")
        points.append(vertices @ np.asarray(matrix)[:3, :3].T + np.asarray(matrix)[:3, 3])
        faces.append(np.asarray(one.faces, np.int64) + count)
        uv = getattr(one.visual, "uv", None)
        uvs.append(None if uv is None or len(uv) != len(vertices) else np.asarray(uv, np.float64))
        count += len(vertices)
    if not meshes:
        return np.empty((0, 3)), np.empty((0, 3), np.int64), None
    known = [uv for uv in uvs if uv is not None]
    return np.concatenate(points), np.concatenate(faces), np.concatenate(known) if len(known) == len(uvs) else None


def _areas(corners: np.ndarray) -> np.ndarray:
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    return np.linalg.norm(np.cross(a, b), axis=-1) / 2


def _require_area(areas: np.ndarray, least: float, text: str) -> None:
    count = np.count_nonzero(areas <= least)
    if count:
        raise ImageError(f"{text.format(count)}; remove them, for example by merging close vertices")


def _neighbors(faces: np.ndarray, name: str) -> np.ndarray:
    """Index of the face across each edge."""
    start, end = np.roll(faces, -1, 1).reshape(-1), np.roll(faces, -2, 1).reshape(-1)  # of the edge opposite a corner
    edges = np.stack([np.minimum(start, end), np.maximum(start, end)], -1)
    _, edge, count = np.unique(edges, axis=0, return_inverse=True, return_counts=True)
    edge = edge.reshape(-1)
    if (count > 2).any():
        raise ImageError(
            f"{name} has {np.count_nonzero(count > 2)} non-manifold edges, where more than two triangles meet:"
            " split the mesh there"
        )
    order = np.argsort(edge, kind="stable")
    two = np.flatnonzero(edge[order][1:] == edge[order][:-1])
    one, other = order[two], order[two + 1]
    turned = np.count_nonzero(start[one] == start[other])
    if turned:
        raise ImageError(
            f"{name} has {turned} edges whose two triangles face opposite sides; make its normals consistent"
        )
    across = np.full(faces.size, -1, np.int64)
    across[one], across[other] = other // 3, one // 3
    return across.reshape(-1, 3)


def _unwrapped(points: np.ndarray, faces: np.ndarray, width: int, height: int) -> np.ndarray:
    """UVs of charts by xatlas."""
    try:
        import xatlas
    except ImportError as error:
        raise ParameterError(f"the mesh has no UVs, and unwrapping requires xatlas: {_INSTALL}") from error
    atlas = xatlas.Atlas()
    atlas.add_mesh(points.astype(np.float32), faces.astype(np.uint32))
    packing = xatlas.PackOptions()
    packing.resolution, packing.padding = min(width, height), _PADDING
    atlas.generate(pack_options=packing)
    _, indices, uv = atlas[0]
    # xatlas chooses the size of its atlas: scale without distortion
    scale = min(width / atlas.width, height / atlas.height)
    return uv.astype(np.float64)[indices] * (atlas.width, atlas.height) * scale / (width, height)


def _check_charts(uv: np.ndarray, name: str, tiles: tuple[int, int]) -> None:
    broken = np.count_nonzero(~np.isfinite(uv).all((1, 2)))
    if broken:
        raise ImageError(f"{name} has {broken} triangles with NaN or Inf UVs")
    outside = np.count_nonzero(((uv < -_INSIDE) | (uv > np.array(tiles) + _INSIDE)).any((1, 2)))
    if outside:
        least = np.ceil(uv.max((0, 1)) - _INSIDE)
        if uv.min() >= -_INSIDE and least.max() <= _MOST_TILES:
            raise ImageError(
                f"{name} has {outside} triangles with UVs outside {_span(tiles)};"
                f" set udim={least[0]:.0f}x{least[1]:.0f} if they are UDIM tiles, else pack the charts into one tile"
            )
        raise ImageError(
            f"{name} has {outside} triangles with UVs outside {_span(tiles)}; pack the charts into one tile"
        )
    between = (np.floor(uv.max(1) - _INSIDE) > np.floor(uv.min(1) + _INSIDE)).any(1)
    if between.any():
        raise ImageError(
            f"{name} has {np.count_nonzero(between)} triangles that span several UDIM tiles; split them at the borders"
        )
    flat = np.concatenate([uv, np.zeros_like(uv[..., :1])], -1)
    _require_area(_areas(flat), _FLAT, f"{name} has {{}} triangles whose UVs have no area")


def _span(tiles: tuple[int, int]) -> str:
    return "0 to 1" if tuple(tiles) == (1, 1) else f"the {tiles[0]}x{tiles[1]} tiles"


def _charts(faces: np.ndarray, across: np.ndarray, uv: np.ndarray) -> np.ndarray:
    """Index of the chart of each face: faces belong together where their UVs agree along an edge."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    joined = across >= 0
    for corner in range(3):
        face = np.flatnonzero(across[:, corner] >= 0)
        other = across[face, corner]
        for end in ((corner + 1) % 3, (corner + 2) % 3):
            at = np.argmax(faces[other] == faces[face, end][:, None], axis=1)
            joined[face, corner] &= (np.abs(uv[other, at] - uv[face, end]) < 1e-7).all(-1)
    face, edge = np.nonzero(joined)
    links = coo_matrix((np.ones(len(face), bool), (face, across[face, edge])), shape=(len(faces), len(faces)))
    return connected_components(links, directed=False)[1].astype(np.int64)
