# SPDX-License-Identifier: Apache-2.0
"""Delivers atlases of Wang tiles to renderers: index image, shaders, MaterialX and USD documents, and a web page."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path, PurePosixPath
from typing import NamedTuple

from oiiotex.engine.deferred import np
from oiiotex.engine.errors import Error

from ..api import materials
from ..api.files import temporary_beside
from ..api.images import PARAMETERS, TAG, Image, Session, from_array, read, write
from ..materials.documents import Described, write_usd
from ..materials.preview import srgb_of
from ..materials.wang_documents import WangMaterial, write_wang_materialx

_PAGE = 1024  # px; longest side of the atlas in the web page


class WangFiles(NamedTuple):
    """What `write_wang` has written next to the atlases.

    Attributes
    ----------
    side : int
        Tiles along a side of an atlas.
    index_file : str
        The index image.
    tiles : mapping of role to str
        A tile of each map that repeats without seams, for readers without a shader.
    plane : (256, 256, 3) uint8
        The content of the index image.
    size_m : (float, float)
        Width and height of a tile in units of texture coordinates.
    """

    side: int
    index_file: str
    tiles: dict[str, str]
    plane: np.ndarray
    size_m: tuple[float, float]


def delivered(
    files: Mapping[str, Path],
    folder: Path,
    name: str,
    check: Callable[[Mapping[str, Image]], object],
    finish: Callable[[Mapping[str, str], Path], object],
) -> list[str]:
    """Write atlases and what belongs to them into a folder, one file atomically after another; others there are kept.

    `files`: atlases by role. `check`: refuses them by role. `finish`: (their names by role, a folder that holds them)
    adds the rest to that folder.
    Returns the names of the written files.
    """
    with tempfile.TemporaryDirectory(prefix="oiiotex") as text:
        work = Path(text)
        atlases = {role: f"{name}_{role}{path.suffix}" for role, path in files.items()}
        check({role: read(str(path)) for role, path in files.items()})
        for role, path in files.items():
            shutil.copyfile(path, work / atlases[role])
        finish(atlases, work)
        folder.mkdir(parents=True, exist_ok=True)
        names = sorted(path.name for path in work.iterdir())
        for one in names:
            with temporary_beside(folder / one) as temporary:
                shutil.copyfile(work / one, temporary)
    return names


def write_wang(
    atlases: Mapping[str, str],
    folder: Path,
    name: str,
    seed: int,
    size_m: tuple[float, float],
    relief: float,
    hand: str,
    textures: Mapping[str, str] | None = None,
) -> WangFiles:
    """Write everything that renderers need in addition to the atlases of a folder.

    Parameters
    ----------
    atlases : mapping of role to str
        Files of --texstationarize:pack=atlas, of one run, below the folder. The color is required.
    folder : Path
    name : str
    seed : int
        Arrangement of the tiles: that of an .oiiotex file with the same seed.
    size_m : (float, float)
        Width and height of a tile in units of texture coordinates.
    relief : float
        Distance between heights 0 and 1; 0: heights are not connected.
    hand : str
        Convention of the normals.
    textures : mapping of role to str, optional
        Files below the folder that MaterialX reads instead: MIP-mapped textures of the atlases.

    Raises
    ------
    Error
        A file is not an atlas, or they do not belong together; MaterialX or usd-core is missing.
    """
    maps = {role: read(str(folder / file)) for role, file in atlases.items()}
    side = side_of(maps)

    def beside(role: str, word: str) -> PurePosixPath:
        """`NAME_color.png` -> `NAME_WORD.png`; `color.png` -> `WORD.png`."""
        path = PurePosixPath(atlases[role])
        return path.with_name(f"{path.stem.removesuffix(role)}{word}{path.suffix}")

    tiles = {role: str(beside(role, f"tile_{role}")) for role in atlases}
    for role, image in maps.items():
        tile = materials.first_tile(image)
        write(_as_opengl(tile) if role == "normal" and hand == "directx" else tile, folder / tiles[role])
    index, plane = str(beside("color", "index").with_suffix(".png")), materials.index_image(side * side, seed)
    write(from_array(plane), folder / index)
    space = maps["color"].first.spec.get_string_attribute(TAG)
    described = Described(name, tiles, space, "opengl", tile_m=size_m, relief=relief)
    material = WangMaterial(
        described.identifier, textures or atlases, index, side, space, hand, size_m, relief if "height" in maps else 0.0
    )
    write_wang_materialx(material, folder / f"{name}.mtlx")
    write_usd(described, folder)
    for shader in materials.SHADERS:
        (folder / shader).write_text(materials.shader(shader))
    _write_page(maps["color"], name, side, folder, folder / index)
    return WangFiles(side, index, tiles, plane, size_m)


def side_of(maps: Mapping[str, Image]) -> int:
    """Tiles along a side of the atlases."""
    if "color" not in maps:
        raise Error(f"{', '.join(maps) or 'no maps'}: expected color=FILE")
    first = maps["color"]
    for role, image in maps.items():
        spec = image.first.spec
        side = materials.atlas_side(spec)
        if not side:
            raise Error(
                f"{image.source} is not an atlas: make it with --texstationarize:variants=16:pack=atlas, as EXR or PNG,"
                " which keep the attribute oiiotex:atlas"
            )
        if len(image.parts) > 1:
            raise Error(f"{image.source} has {len(image.parts)} parts: expected only the atlas; omit st=1 and drift=1")
        if role == "normal" and spec.nchannels < 3:
            raise Error(f"{image.source} has {spec.nchannels} channels: expected a normal map, which has 3")
        if (side, spec.width, spec.height) != (
            materials.atlas_side(first.first.spec), first.first.spec.width, first.first.spec.height,
        ):  # fmt: skip
            raise Error(f"{image.source} does not have the size of {first.source}; make all maps in one run")
        made = [one.get_string_attribute(PARAMETERS) for one in (spec, first.first.spec)]
        if all(made) and made[0] != made[1]:
            raise Error(f"{image.source} and {first.source} are from different runs; make all maps in one run")
    return materials.atlas_side(first.first.spec)


def _as_opengl(normals: Image) -> Image:
    """Normals with y upwards, as USD's validators require of integer files."""
    pixels = normals.first.pixels().copy()
    pixels[..., 1] = (np.iinfo(pixels.dtype).max if pixels.dtype.kind == "u" else 1) - pixels[..., 1]
    return from_array(pixels)


def _write_page(color: Image, name: str, side: int, folder: Path, index: Path) -> None:
    picture, spec = folder / "atlas.png", color.first.spec
    step = -(-max(spec.width, spec.height) // _PAGE)
    size = [side * max(1, n // side // step) for n in (spec.height, spec.width)]
    texels = srgb_of(color.first, Session().resources, size)
    write(from_array(np.rint(255 * texels).astype(np.uint8)), picture)
    aspect = spec.width / spec.height
    (folder / f"{name}.html").write_text(materials.viewer_page(name, picture, index, side, aspect))
    picture.unlink()
