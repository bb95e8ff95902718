# SPDX-License-Identifier: Apache-2.0
"""--texatlas: texture on the surface of a mesh, over the borders of its charts."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections import defaultdict
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest
import trimesh

from oiiotex import filters
from oiiotex.engine import errors
from oiiotex.oiiotool.cli.running.line_run import run
from oiiotex.surfaces.atlas.charts import Frames, walk
from oiiotex.surfaces.atlas.mesh import read_mesh
from oiiotex.surfaces.atlas.surface import ONE, Neighbors, Surface
from tests import pictures
from tests.analysis.test_superpixels import resources_of
from tests.any_filter import buffer, pixels
from tests.conftest import load, oiiotex, save
from tests.peer import refused

SIDE = 192
PLANE = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nf 1/1 2/2 3/3\nf 1/1 3/3 4/4\n"
OWN = {"cube": pictures.cube_obj(), "plane": PLANE}  # with UVs of their own


def bumpy(seed: int = 0) -> trimesh.Trimesh:
    """As a scan of a stone: a sphere with bumps of three sizes."""
    ball = trimesh.creation.icosphere(4)
    directions = np.random.default_rng(seed).normal(size=(3, 3))
    bumps = sum(np.sin(ball.vertices @ way * 2**n + n) / 2**n for n, way in enumerate(directions))
    ball.vertices *= (1 + 0.12 * bumps)[:, None]
    return ball


def arch() -> trimesh.Trimesh:
    """A part of a building: two pillars and the half ring between them, sharp edges, flat and bent sides."""
    angles = np.linspace(0, np.pi, 17)
    ring = np.stack([np.cos(angles), np.sin(angles)], -1)
    feet = np.array([[1, -1.2], [-1, -1.2]])
    outer, inner = (np.concatenate([feet[:1] * (r, 1), ring * r, feet[1:] * (r, 1)]) for r in (1, 0.6))
    count = len(outer)
    corners = [np.insert(path, 1, depth, axis=1) for depth in (-0.3, 0.3) for path in (outer, inner)]
    around = [np.arange(count) + n * count for n in (0, 1, 3, 2)]  # front outer, front inner, back inner, back outer
    quads = [
        np.stack([a[:-1], a[1:], b[1:], b[:-1]], -1) for a, b in zip(around, [*around[1:], around[0]], strict=True)
    ]
    ends = [[row[n] for row in around] for n in (0, count - 1)]
    quads.append([ends[0], ends[1][::-1]])
    faces = [[[a, b, c], [a, c, d]] for a, b, c, d in np.concatenate(quads)]
    return trimesh.Trimesh(np.concatenate(corners), np.reshape(faces, (-1, 3)), process=False)


def mesh_file(kind: str, folder: Path) -> Path:
    """A mesh in a file; see OWN."""
    path = folder / f"{kind}.{'obj' if kind in OWN else 'ply'}"
    if kind in OWN:
        path.write_text(OWN[kind])
    else:
        made = {"sphere": lambda: trimesh.creation.icosphere(3), "torus": lambda: trimesh.creation.torus(1, 0.4)}
        {**made, "scan": bumpy, "arch": arch}[kind]().export(path)
    return path


def parsed(text: str) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Points, UVs, and of each face the numbers of its points and of its UVs."""
    words = [line.split() for line in text.splitlines() if line]
    points, uvs = (np.array([w[1:] for w in words if w[0] == key], float) for key in ("v", "vt"))
    faces = np.array([[corner.split("/") for corner in w[1:]] for w in words if w[0] == "f"], int) - 1
    return points, uvs, faces[..., 0], faces[..., 1]


def differences(text: str, image: np.ndarray) -> tuple[float, float]:
    """How much colors differ across borders of charts, and beside them at the same distance on the surface.

    Pairs of places 0.75 px to both sides of points of seam edges, and pairs 2.5 and 4 px beside these: nearer ones
    would often be one pixel inside of a chart, and never across its border.
    """
    points, uvs, faces, corners = parsed(text)
    height, width = image.shape[:2]

    def area(a: np.ndarray) -> np.ndarray:
        return np.linalg.norm(np.cross(a[:, 1] - a[:, 0], a[:, 2] - a[:, 0]), axis=-1)

    flat = np.concatenate([uvs[corners] * (width, height), np.zeros((*corners.shape, 1))], -1)
    texel = np.sqrt(area(points[faces]).sum() / area(flat).sum())
    sharing = defaultdict(list)
    for face in range(len(faces)):
        for corner in range(3):
            ends = faces[face, (corner + 1) % 3], faces[face, (corner + 2) % 3]
            sharing[tuple(sorted(ends))].append((face, corner))

    def color(face: int, corner: int, at: np.ndarray, depth: float) -> np.ndarray:
        """At a place of an edge, so many texels inwards."""
        a, b, c = points[faces[face]]
        apex, low = points[faces[face, corner]], points[faces[face, (corner + 1) % 3]]
        edge = points[faces[face, (corner + 2) % 3]] - low
        edge /= np.linalg.norm(edge)
        inwards = apex - low - ((apex - low) @ edge) * edge
        place = at + inwards / np.linalg.norm(inwards) * depth * texel
        s, t = np.linalg.lstsq(np.stack([b - a, c - a], 1), place - a, rcond=None)[0]
        u, v = np.array([1 - s - t, s, t]) @ uvs[corners[face]]
        return image[min(int((1 - v) * height), height - 1), min(int(u * width), width - 1)]

    across, beside = [], []
    for (low, high), two in sharing.items():
        uv = [{faces[f, k]: tuple(np.round(uvs[corners[f, k]], 6)) for k in range(3)} for f, _ in two]
        if len(two) < 2 or all(uv[0][end] == uv[1][end] for end in (low, high)):
            continue
        steps = max(1, int(np.linalg.norm(points[high] - points[low]) / texel))
        for share in (np.arange(steps) + 0.5) / steps:
            at = points[low] + share * (points[high] - points[low])
            across.append(color(*two[0], at, 0.75) - color(*two[1], at, 0.75))
            beside += [color(*one, at, 2.5) - color(*one, at, 4) for one in two]
    return float(np.linalg.norm(across, axis=-1).mean()), float(np.linalg.norm(beside, axis=-1).mean())


PHOTO = pictures.pebbles(96, 96, 1)


@pytest.mark.parametrize(
    "kind", ["cube", *(pytest.param(kind, marks=pytest.mark.slow) for kind in ("torus", "scan", "arch"))]
)
def test_texture_runs_on_over_borders_of_charts(kind, tmp_path):
    """Over three seeds together: where stones and gaps come to lie of one has the ratio go up and down by a tenth."""
    path, out = mesh_file(kind, tmp_path), tmp_path / "out.obj"
    across, beside = 0.0, 0.0
    for seed in range(3):
        made = filters.atlas(buffer(PHOTO), mesh=path, size=(SIDE, SIDE), obj=out, seed=seed)
        more = differences(out.read_text(), pixels(made))
        across, beside = across + more[0], beside + more[1]
    assert across / beside <= 1.15


def test_a_photo_laid_over_the_charts_jumps(tmp_path):
    """The measure sees what it should: the same charts, filled without regard to the surface."""
    laid = np.tile(PHOTO, (2, 2, 1))
    across, beside = differences(pictures.cube_obj(), laid)
    assert across / beside > 1.5


def test_a_way_over_a_flat_surface_is_straight(tmp_path):
    """Whatever its triangles are, and with it whatever is unfolded."""
    plane = trimesh.creation.box((2, 2, 1e-3)).subdivide().subdivide().subdivide()
    plane.vertices[:, :2] += np.random.default_rng(1).uniform(-0.03, 0.03, (len(plane.vertices), 2))
    plane.export(tmp_path / "plane.ply")
    mesh = read_mesh(tmp_path / "plane.ply", 128, 128)
    frames = Frames.of(mesh, 0.01)
    center = mesh.corners.mean(1)
    start = np.flatnonzero((np.abs(center[:, :2]).max(1) < 0.5) & (np.ptp(mesh.corners[..., 2], axis=1) == 0))
    assert len(start) > 50
    step = np.zeros((len(start), 3))
    step[:, :2] = np.random.default_rng(2).uniform(-0.4, 0.4, (len(start), 2))
    end, weights = walk(mesh, frames, start, np.full((len(start), 3), 1 / 3), step)
    np.testing.assert_allclose(np.einsum("nc,nck->nk", weights, mesh.corners[end]), center[start] + step, atol=1e-9)


TWO_CHARTS = """v 0 0 0\nv 1 0 0\nv 2 0 0\nv 0 1 0\nv 1 1 0\nv 2 1 0
vt 0.05 0.05\nvt 0.45 0.05\nvt 0.45 0.45\nvt 0.05 0.45
vt 0.9 0.6\nvt 0.9 0.8\nvt 0.7 0.8\nvt 0.7 0.6
f 1/1 2/2 5/3\nf 1/1 5/3 4/4\nf 2/5 3/6 6/7\nf 2/5 6/7 5/8
"""


def test_neighbors_lie_where_steps_on_the_surface_lead(device, tmp_path):
    """Two squares side by side, the other one turned by a quarter and half as large in the atlas."""
    (tmp_path / "two.obj").write_text(TWO_CHARTS)
    mesh = read_mesh(tmp_path / "two.obj", 100, 100)
    assert mesh.chart.max() == 1
    frames = Frames.of(mesh, 1 / 40)
    surface = Surface.of(mesh, frames, 100, 100, 0, "two.obj")
    offsets = np.array([[2, 0], [0, 2], [-2, 1], [0, 0]])
    every = np.arange(len(surface.place))
    x, y = surface.centers(every).T / 100
    first = x < 0.5
    solid = np.where(first, [(x - 0.05) / 0.4, (0.95 - y) / 0.4], [1 + (0.4 - y) / 0.2, (0.9 - x) / 0.2]).T
    tables = Neighbors(surface, offsets, device.program("atlas", CHANNELS=3), resources_of(device)).tables()
    moves, row = tables["moves"][surface.face], tables["table"]
    there = surface.index.reshape(-1).take(surface.place[:, None] + moves @ (1, 100), mode="clip")
    there = np.where(row[:, None] < 0, there, tables["beside"][row])
    rest = np.where(row[:, None, None] < 0, tables["steps"][surface.face], tables["rests"][row])
    assert 0 < np.count_nonzero(row >= 0) < len(row) / 2
    steps = np.einsum("nij,kj->nki", frames.step[surface.face], offsets)[..., :2]
    wanted = solid[:, None] + steps
    inside = ((wanted > 0) & (wanted < (2, 1))).all(-1)
    away = np.abs(solid[there] - wanted)
    assert away[inside].max() <= 0.5 / 20 + 1e-6  # half a pixel of the coarser chart, which is a twentieth wide
    assert (first[there] != first[:, None])[inside].sum() > 100
    np.testing.assert_array_equal(there[:, 3], every)
    beside = np.einsum("nkij,nkj->nki", frames.step[surface.face[there]], rest / ONE)[..., :2]
    apart = np.abs(wanted + beside - solid[there]).max(-1) * 40  # in pixels of the photo
    assert apart[inside & (surface.face[there] == surface.face[:, None])].max() <= 0.5 / ONE + 1e-9
    assert apart[inside].max() <= 0.15  # faces have directions of their own


def test_threads_do_not_show_and_the_map_says_where_pixels_come_from(tmp_path):
    path, photo = mesh_file("cube", tmp_path), buffer(PHOTO)
    one = filters.atlas(photo, mesh=path, size=(128, 96), st=True, nthreads=1)
    three = filters.atlas(photo, mesh=path, size=(128, 96), nthreads=3)
    image, st = one["atlas"], one["st"]
    np.testing.assert_array_equal(pixels(image), pixels(three))
    np.testing.assert_array_equal(pixels(filters.warp(photo, st)), pixels(image))


def test_only_what_the_mask_allows_is_taken(tmp_path):
    picture = np.where(np.arange(96)[:, None, None] < 60, PHOTO, [1.0, 0.0, 0.0])
    mask = buffer((np.indices((96, 96))[0] < 60)[..., None] * 1.0, names=("Y",))
    made = filters.atlas(buffer(picture), mask=mask, mesh=mesh_file("cube", tmp_path), size=(96, 96))
    assert not (pixels(made) == np.float32([1, 0, 0])).all(-1).any()


def test_charts_that_are_made_are_handed_out(tmp_path):
    path, out = mesh_file("sphere", tmp_path), tmp_path / "out.obj"
    save(PHOTO, tmp_path / "photo.png")
    done = oiiotex("photo.png", f"--texatlas:mesh={path}:size=96x96:obj={out}", "-v", "-o", "a.exr", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "charts by xatlas" in done.stderr + done.stdout
    made, again = read_mesh(path, 96, 96), read_mesh(out, 96, 96)
    assert made.unwrapped and not again.unwrapped
    assert made.chart.max() == again.chart.max()
    np.testing.assert_allclose(np.sort(made.areas()[1]), np.sort(again.areas()[1]), atol=1e-6)


CUBE = pictures.cube_obj()
WRONG = {
    "non-manifold": (CUBE + "v 3 3 3\nf 1/1 2/2 9/3\n", "non-manifold edges"),
    "degenerate": (CUBE + "v 5 5 5\nv 6 6 6\nv 7 7 7\nf 9/1 10/2 11/3\n", "1 degenerate triangles"),
    "overlapping": (CUBE + "v 5 5 5\nv 6 5 5\nv 6 6 5\nf 9/1 10/2 11/3\n", "charts overlap on"),
    "NaN": (CUBE.replace("v 0.0 0.0 0.0", "v nan 0 0", 1), "vertices with NaN or Inf"),
    "flat": (CUBE.replace("v 0.0 0.0 0.0", "v 0 0", 1), "vertices of 2 coordinates: expected 3"),
    "far UV": (CUBE.replace("vt 0.02", "vt 90000000000000000000.02", 1), "outside 0 to 1; pack the charts"),
    "NaN UV": (CUBE.replace("vt 0.02", "vt 1e999", 1), "NaN or Inf UVs"),
    "empty": ("# nothing\n", ""),
    "points": ("v 0 0 0\nv 1 0 0\nv 0 1 0\n", ""),
    "outside": (CUBE.replace("vt 0.02", "vt -3.02", 1), "UVs outside 0 to 1"),
    "tiles": (CUBE.replace("vt 0.02", "vt 2.98", 1), "set udim=3x1 if they are UDIM tiles"),
    "turned": (CUBE.replace("f 1/1 2/2 4/3", "f 1/1 4/3 2/2", 1), "face opposite sides"),
    "flat UVs": (CUBE.replace("f 1/1 2/2 4/3", "f 1/1 2/1 4/1", 1), "UVs have no area"),
}


@pytest.mark.parametrize("case", WRONG)
def test_a_mesh_that_is_no_surface_is_refused_in_one_line(case, tmp_path):
    text, says = WRONG[case]
    (tmp_path / "m.obj").write_text(text)
    save(PHOTO[:8, :8], tmp_path / "photo.png")
    error = refused(tmp_path, "photo.png --texatlas:mesh=m.obj:size=64x64 -o o.exr", says)
    assert error.startswith("--texatlas") and "m.obj" in error


def test_what_is_missing_or_does_not_fit_is_said(tmp_path, monkeypatch):
    cube, sphere = mesh_file("cube", tmp_path), mesh_file("sphere", tmp_path)
    photo = buffer(PHOTO)
    with pytest.raises(errors.ImageError, match=r"nowhere\.obj .*mesh"):
        filters.atlas(photo, mesh=tmp_path / "nowhere.obj")
    with pytest.raises(errors.ParameterError, match=r"a pixel of the photo .* expected 0.5 to 2"):
        filters.atlas(photo, mesh=cube, scale=100.0)
    with pytest.raises(errors.ParameterError, match=r"ends in \.obj"):
        filters.atlas(photo, mesh=cube, obj=tmp_path / "out.ply")
    monkeypatch.setitem(sys.modules, "xatlas", None)
    with pytest.raises(errors.ParameterError, match=r"no UVs.*pip install 'oiiotex\[atlas\]'"):
        filters.atlas(photo, mesh=sphere)
    monkeypatch.setitem(sys.modules, "trimesh", None)
    with pytest.raises(errors.ParameterError, match=r"pip install 'oiiotex\[atlas\]'"):
        filters.atlas(photo, mesh=cube)


def test_a_pipe_beside_a_mesh_is_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "pipe.bin")
    described = {"asset": {"version": "2.0"}, "buffers": [{"uri": "pipe.bin", "byteLength": 36}]}
    (tmp_path / "mesh.gltf").write_text(json.dumps(described))
    line = [
        sys.executable,
        "-P",
        "-c",
        "import sys; from pathlib import Path; from oiiotex.surfaces.atlas.mesh import read_mesh",
    ]
    line[-1] += "; read_mesh(Path(sys.argv[1]), 64, 64)"
    done = subprocess.run([*line, tmp_path / "mesh.gltf"], capture_output=True, text=True, timeout=60)
    assert "mesh.gltf cannot be read as a mesh: pipe.bin is not a regular file" in done.stderr


def test_scale_is_the_width_of_the_photo_on_the_surface(tmp_path):
    """Pieces that are copied whole go on by so many pixels of the photo for one of the atlas."""
    path = mesh_file("plane", tmp_path)
    for scale in (0.8, 1.2):
        st = pixels(filters.atlas(buffer(PHOTO), mesh=path, size=(120, 120), scale=scale, st=True)["st"])
        on = np.rint(np.diff(st[..., 0], axis=1) * 96)
        whole = (on >= 0) & (on <= 2)
        assert whole.mean() > 0.5
        assert on[whole].mean() == pytest.approx(96 / (120 * scale), rel=0.05)


@pytest.mark.parametrize("convention", ["opengl", "directx"])
def test_normals_turn_with_the_texture(convention, tmp_path):
    """A photo of a slope towards its right: on a plane whose charts are turned and mirrored it falls where it fell."""
    flat = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n"
    layouts = {"as it is": (1, 2, 3, 4), "a quarter": (2, 3, 4, 1), "mirrored": (2, 1, 4, 3)}
    sign = 1 if convention == "opengl" else -1
    slope = np.float32([0.6, 0.3 * sign, np.sqrt(1 - 0.45)])
    normals = np.broadcast_to((slope + 1) / 2, (64, 64, 3))
    for at in layouts.values():
        a, b, c, d = (f"{point}/{uv}" for point, uv in zip((1, 2, 3, 4), at, strict=True))
        path = tmp_path / "plane.obj"
        path.write_text(flat + f"f {a} {b} {c}\nf {a} {c} {d}\n")
        color, made = filters.atlas(
            buffer(PHOTO[:64, :64]), maps=[buffer(normals)], mesh=path, size=(48, 48), kinds=("color", "normal"),
            mapweights=(1, 0), normals=convention,
        )  # fmt: skip
        mesh = read_mesh(path, 48, 48)
        right = Frames.of(mesh, 1.0).step[0, :, 0]
        up = np.cross((0, 0, 1), right)
        uvs = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], float)[np.array(at) - 1]
        solid = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], float)
        along_u = (solid - 0.5).T @ (uvs[:, 0] - 0.5)
        along_v = (solid - 0.5).T @ (uvs[:, 1] - 0.5)
        shown = 2 * pixels(made)[24, 24] - 1
        np.testing.assert_allclose(
            shown[0] * along_u + sign * shown[1] * along_v, slope[0] * right + sign * slope[1] * up, atol=1e-5
        )
        assert np.ptp(pixels(made), axis=(0, 1)).max() < 1e-5
        assert pixels(color).shape == (48, 48, 3)


def test_udim_tiles_are_one_atlas_that_is_cut(tmp_path):
    """A cube whose sides lie in three tiles, two above each other in each."""
    lines = []
    for line in pictures.cube_obj().splitlines():
        if line.startswith("vt"):
            u, v = map(float, line.split()[1:])
            line = f"vt {3 * u:.6f} {2 * v:.6f}"
        lines.append(line)
    (tmp_path / "cube.obj").write_text("\n".join(lines))
    save(PHOTO, tmp_path / "photo.png")
    words = "photo.png --texatlas:mesh=cube.obj:size=32x32:udim=3x2:obj=out.obj -o all.exr -o:udim=3x2 t.<UDIM>.exr"
    assert run(words.split(), tmp_path) == 0
    whole = load(tmp_path / "all.exr")
    assert whole.shape == (64, 96, 3)
    np.testing.assert_array_equal(load(tmp_path / "t.1012.exr"), whole[:32, 32:64])
    one = filters.atlas(oiio.ImageBuf(str(tmp_path / "photo.png")), mesh=mesh_file("cube", tmp_path), size=(96, 64))
    np.testing.assert_allclose(pixels(one) / 255, whole, atol=1e-3)
    np.testing.assert_allclose(parsed((tmp_path / "out.obj").read_text())[1].max(0), parsed("\n".join(lines))[1].max(0))


def test_tiles_that_do_not_fit_are_said(tmp_path):
    sphere = mesh_file("sphere", tmp_path)
    with pytest.raises(errors.ParameterError, match=r"udim=.*2x1.*: requires UVs, which sphere.ply"):
        filters.atlas(buffer(PHOTO), mesh=sphere, size=(64, 64), udim=(2, 1))
    (tmp_path / "between.obj").write_text(PLANE.replace("vt 1 0", "vt 1.5 0").replace("vt 1 1", "vt 1.5 1"))
    with pytest.raises(errors.ImageError, match=r"2 triangles .*UDIM"):
        filters.atlas(buffer(PHOTO), mesh=tmp_path / "between.obj", size=(64, 64), udim=(2, 1))
