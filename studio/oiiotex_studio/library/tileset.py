# SPDX-License-Identifier: Apache-2.0
"""Delivers atlases of --textransition to editors of tile maps: a tile set and a map for Tiled, a tile set for Godot.

Tiled: TMX map format 1.8, its elements `wangset` and `wangtile`. Godot 4: the text of a TileSet resource with a terrain
set.
"""

from __future__ import annotations

import json
import random
from collections.abc import Mapping
from pathlib import Path
from xml.etree import ElementTree as xml

from oiiotex.engine.errors import Error

from ..api import materials
from ..api.images import Image, read

_TILED = [(0, 1), (0, 2), (1, 2), (2, 2), (2, 1), (2, 0), (1, 0), (0, 0)]  # points of a wangid, clockwise from the top
_GODOT = {  # points, by the name of a peering bit
    "right_side": (1, 2), "bottom_right_corner": (2, 2), "bottom_side": (2, 1), "bottom_left_corner": (2, 0),
    "left_side": (1, 0), "top_left_corner": (0, 0), "top_side": (0, 1), "top_right_corner": (0, 2),
}  # fmt: skip
_COLORS = "#5a8f3c", "#d8b365"  # of the materials in an editor
_MAP = 12, 8  # cells of the example map
Points = list[list[list[int]]]  # of each tile, the materials at its points, by row and column


def write_tileset(atlases: Mapping[str, str], folder: Path, name: str, names: tuple[str, str]) -> None:
    """Write NAME.tsx, NAME.tmx and NAME.tres next to the atlases of a folder.

    Parameters
    ----------
    atlases : mapping of role to str
        Files of --textransition, of one run, in the folder. The color is required; Godot also gets the normals.
    folder : Path
    name : str
    names : (str, str)
        Of the materials.

    Raises
    ------
    Error
        A file is not such an atlas, or they do not belong together.
    """
    count, size = checked({role: read(str(folder / file)) for role, file in atlases.items()})
    points, columns = materials.controls(count).tolist(), materials.TRANSITION_LAYOUT[count].width
    _write_xml(_tsx(points, columns, size, atlases["color"], name, names), folder / f"{name}.tsx")
    _write_xml(_tmx(points, size, name), folder / f"{name}.tmx")
    (folder / f"{name}.tres").write_text(_tres(points, columns, size, atlases, names), encoding="utf-8")


def checked(maps: Mapping[str, Image]) -> tuple[int, tuple[int, int]]:
    """The number of tiles, and the size of a tile."""
    if "color" not in maps:
        raise Error(f"{', '.join(maps) or 'no maps'}: expected color=FILE")
    found = {}
    for role, image in maps.items():
        spec = image.first.spec
        if not (count := materials.count_of(spec)):
            raise Error(
                f"{image.source} is not an atlas of --textransition; save it as EXR or PNG, which keep its attributes"
            )
        found[role] = count, (spec.width, spec.height)
    for role, one in found.items():
        if one != found["color"]:
            raise Error(
                f"{maps[role].source} does not have the size of {maps['color'].source}; make all maps in one run"
            )
    count, (width, height) = found["color"]
    columns, rows = materials.TRANSITION_LAYOUT[count]
    return count, (width // columns, height // rows)


def _material(points: list[list[int]], place: tuple[int, int]) -> int | None:
    """The material at a point of a 3 x 3 grid of a tile, None if the tile has none there."""
    y, x = place
    if len(points) == 3:
        return points[y][x]
    return None if 1 in place else points[y // 2][x // 2]


def _tsx(
    points: Points, columns: int, size: tuple[int, int], image: str, name: str, names: tuple[str, str]
) -> xml.Element:
    width, height = size
    rows = len(points) // columns
    root = xml.Element(
        "tileset", version="1.8", name=name, tilewidth=str(width), tileheight=str(height), tilecount=str(len(points)),
        columns=str(columns),
    )  # fmt: skip
    xml.SubElement(root, "image", source=image, width=str(columns * width), height=str(rows * height))
    kind = "corner" if len(points[0]) == 2 else "mixed"
    wangset = xml.SubElement(xml.SubElement(root, "wangsets"), "wangset", name=name, type=kind, tile="-1")
    for each, (color, one) in enumerate(zip(_COLORS, names, strict=True)):
        whole = next(n for n, tile in enumerate(points) if all(value == each for row in tile for value in row))
        xml.SubElement(wangset, "wangcolor", name=one, color=color, tile=str(whole), probability="1")
    for number, tile in enumerate(points):
        at = [_material(tile, place) for place in _TILED]
        text = ",".join("0" if value is None else str(1 + value) for value in at)
        xml.SubElement(wangset, "wangtile", tileid=str(number), wangid=text)
    return root


def _tmx(points: Points, size: tuple[int, int], name: str) -> xml.Element:
    """An example map."""
    across, down = _MAP
    cells = _example(points, across, down)
    root = xml.Element(
        "map", version="1.8", orientation="orthogonal", renderorder="right-down", width=str(across), height=str(down),
        tilewidth=str(size[0]), tileheight=str(size[1]), infinite="0",
    )  # fmt: skip
    xml.SubElement(root, "tileset", firstgid="1", source=f"{name}.tsx")
    layer = xml.SubElement(root, "layer", id="1", name="ground", width=str(across), height=str(down))
    data = xml.SubElement(layer, "data", encoding="csv")
    data.text = "\n" + ",\n".join(",".join(str(1 + number) for number in row) for row in cells) + "\n"
    return root


def _example(points: Points, across: int, down: int) -> list[list[int]]:
    """Tiles that fit each other: numbers by row and column."""
    numbers = {json.dumps(tile): number for number, tile in enumerate(points)}
    chance = random.Random(1)
    corners = len(points[0]) == 2
    field = [[int(chance.random() < 0.5) for _ in range(across + 2)] for _ in range(down + 2)]
    if corners:
        return [
            [numbers[json.dumps([field[y][x : x + 2], field[y + 1][x : x + 2]])] for x in range(across)]
            for y in range(down)
        ]

    def tile(y: int, x: int) -> int:
        if not field[y][x]:
            return len(points) - 1
        around = [[field[y + dy][x + dx] for dx in (-1, 0, 1)] for dy in (-1, 0, 1)]
        for row, column in ((0, 0), (0, 2), (2, 0), (2, 2)):
            around[row][column] &= around[row][1] & around[1][column]
        return numbers[json.dumps(around)]

    for x in range(across + 2):  # the map ends with the first material
        field[0][x] = field[-1][x] = 0
    for row in field:
        row[0] = row[-1] = 0
    return [[tile(y + 1, x + 1) for x in range(across)] for y in range(down)]


def _tres(
    points: Points, columns: int, size: tuple[int, int], atlases: Mapping[str, str], names: tuple[str, str]
) -> str:
    corners = len(points[0]) == 2
    files = [atlases[role] for role in ("color", "normal") if role in atlases]
    lines = [f'[gd_resource type="TileSet" load_steps={2 * len(files) + 1} format=3]', ""]
    lines += [f'[ext_resource type="Texture2D" path={json.dumps(file)} id="{n}"]' for n, file in enumerate(files, 1)]
    texture = 'ExtResource("1")'
    if len(files) > 1:
        lines += ["", '[sub_resource type="CanvasTexture" id="lit"]', 'diffuse_texture = ExtResource("1")']
        lines += ['normal_texture = ExtResource("2")']
        texture = 'SubResource("lit")'
    region = f"Vector2i({size[0]}, {size[1]})"
    lines += ["", '[sub_resource type="TileSetAtlasSource" id="tiles"]', f"texture = {texture}"]
    lines += [f"texture_region_size = {region}"]
    for number, tile in enumerate(points):
        at = f"{number % columns}:{number // columns}/0"
        # a tile with corners only has the material of most of them in its center
        center = tile[1][1] if not corners else int(sum(map(sum, tile)) >= 2)
        lines += [f"{at} = 0", f"{at}/terrain_set = 0", f"{at}/terrain = {center}"]
        for bit, place in _GODOT.items():
            if (value := _material(tile, place)) is not None:
                lines.append(f"{at}/terrains_peering_bit/{bit} = {value}")
    lines += ["", "[resource]", f"tile_size = {region}", f"terrain_set_0/mode = {int(corners)}"]
    for n, (color, name) in enumerate(zip(_COLORS, names, strict=True)):
        rgb = ", ".join(f"{int(color[at : at + 2], 16) / 255:.3g}" for at in (1, 3, 5))
        lines += [f"terrain_set_0/terrain_{n}/name = {json.dumps(name, ensure_ascii=False)}"]
        lines += [f"terrain_set_0/terrain_{n}/color = Color({rgb}, 1)"]
    return "\n".join([*lines, 'sources/0 = SubResource("tiles")', ""])


def _write_xml(root: xml.Element, path: Path) -> None:
    xml.indent(root)
    xml.ElementTree(root).write(path, encoding="UTF-8", xml_declaration=True)
