# SPDX-License-Identifier: Apache-2.0
"""A material of Wang tiles: a node group that finds a place in the atlas, and an image node for each map."""

from __future__ import annotations

from pathlib import Path

import bpy
from bpy_extras.io_utils import ImportHelper

_INDEX = "index.png"
_GROUP = "Wang Tiles"
_ROLES = ("color", "normal", "roughness", "metal", "height", "opacity", "emission")
_INPUTS = {"roughness": "Roughness", "metal": "Metallic", "opacity": "Alpha", "emission": "Emission Color"}


class WangMaterial(ImportHelper, bpy.types.Operator):
    """Create a material of Wang tiles from the files of `oiiotex-library wang`"""

    bl_idname = "oiiotex.wang_material"
    bl_label = "Wang Material"
    bl_options = {"REGISTER", "UNDO"}
    filename_ext = ".png"
    filter_glob: bpy.props.StringProperty(default=f"*{_INDEX}", options={"HIDDEN"})
    side: bpy.props.IntProperty(name="Side", default=4, min=2, max=8, description="Tiles along a side of the atlas")
    relief: bpy.props.FloatProperty(
        name="Relief", default=0.0, min=0.0, description="Distance between heights 0 and 1; 0: no displacement"
    )
    eevee: bpy.props.BoolProperty(
        name="For EEVEE",
        default=False,
        description="Turn MIP levels off: in EEVEE they draw lines between tiles. Render with 16 samples or more",
    )

    def execute(self, context):
        """Create the material, and assign it to the active object."""
        index = Path(self.filepath)
        name = index.name.removesuffix(_INDEX)
        files = {path.stem: path for path in sorted(index.parent.iterdir()) if path.suffix != ".mtlx"}
        maps = {role: files[f"{name}{role}"] for role in _ROLES if f"{name}{role}" in files}
        if not index.name.endswith(_INDEX) or "color" not in maps:
            self.report({"ERROR"}, f"{index.name}: expected NAME_index.png next to NAME_color, from oiiotex-library")
            return {"CANCELLED"}
        material = bpy.data.materials.new(name.rstrip("_") or index.parent.parent.name)
        material.use_nodes = True
        _build(material, _group(_loaded(index, "Non-Color"), self.side), maps, self.relief, self.eevee)
        if context.active_object is not None and hasattr(context.active_object.data, "materials"):
            context.active_object.data.materials.append(material)
        return {"FINISHED"}


def _loaded(path: Path, space: str):
    image = bpy.data.images.load(str(path), check_existing=True)
    if space:
        image.colorspace_settings.name = space
    return image


def _group(index, side: int):
    """A node group: texture coordinate, and size of a tile in its units -> coordinate in the atlas."""
    group = bpy.data.node_groups.new(_GROUP, "ShaderNodeTree")
    for name, kind, way in (
        ("Vector", "Vector", "INPUT"),
        ("Tile Size", "Vector", "INPUT"),
        ("Vector", "Vector", "OUTPUT"),
    ):
        socket = group.interface.new_socket(name, in_out=way, socket_type=f"NodeSocket{kind}")
        if name == "Tile Size":
            socket.default_value = (1.0, 1.0, 1.0)
    nodes, links = group.nodes, group.links
    given, out = nodes.new("NodeGroupInput"), nodes.new("NodeGroupOutput")

    def of(operation: str, first, second=None):
        node = nodes.new("ShaderNodeVectorMath")
        node.operation = operation
        for socket, value in zip(node.inputs, (first, second), strict=False):
            if isinstance(value, tuple):
                socket.default_value = value
            elif value is not None:
                links.new(value, socket)
        return node.outputs["Vector"]

    # images have v downwards, Blender upwards
    tiles = of("MULTIPLY", of("DIVIDE", given.outputs["Vector"], given.outputs["Tile Size"]), (1.0, -1.0, 0.0))
    cell = of("FLOOR", tiles)
    place = of("DIVIDE", of("ADD", cell, (0.5, 0.5, 0.0)), (float(index.size[0]), -float(index.size[1]), 1.0))
    numbers = nodes.new("ShaderNodeTexImage")
    numbers.image, numbers.interpolation, numbers.extension = index, "Closest", "REPEAT"
    links.new(place, numbers.inputs["Vector"])
    tile = of("MULTIPLY", numbers.outputs["Color"], (255.0, 255.0, 0.0))
    inside = of("ADD", tile, of("SUBTRACT", tiles, cell))
    links.new(of("MULTIPLY", inside, (1 / side, -1 / side, 0.0)), out.inputs["Vector"])
    return group


def _build(material, group, maps: dict[str, Path], relief: float, eevee: bool) -> None:
    """Connect the maps to the material's surface."""
    nodes, links = material.node_tree.nodes, material.node_tree.links
    surface = next(node for node in nodes if node.type == "BSDF_PRINCIPLED")
    surface.inputs["Roughness"].default_value = 0.7  # of photos, as in their MaterialX documents
    coordinate, place = nodes.new("ShaderNodeTexCoord"), nodes.new("ShaderNodeGroup")
    place.node_tree, place.location = group, (-900, 0)
    coordinate.location = (-1100, 0)
    links.new(coordinate.outputs["UV"], place.inputs["Vector"])
    for number, (role, path) in enumerate(maps.items()):
        node = nodes.new("ShaderNodeTexImage")
        node.name = node.label = role
        node.location = (-650, 300 - 300 * number)
        node.image = _loaded(path, "" if role in ("color", "emission") else "Non-Color")
        node.interpolation = "Closest" if eevee else "Linear"
        links.new(place.outputs["Vector"], node.inputs["Vector"])
        color = node.outputs["Color"]
        if role == "color":
            links.new(color, surface.inputs["Base Color"])
        elif role == "normal":
            between = nodes.new("ShaderNodeNormalMap")
            links.new(color, between.inputs["Color"])
            links.new(between.outputs["Normal"], surface.inputs["Normal"])
        elif role == "height" and relief:
            between = nodes.new("ShaderNodeDisplacement")
            between.inputs["Scale"].default_value = relief
            between.inputs["Midlevel"].default_value = 0.0
            links.new(color, between.inputs["Height"])
            output = next(one for one in nodes if one.type == "OUTPUT_MATERIAL")
            links.new(between.outputs["Displacement"], output.inputs["Displacement"])
        elif role in _INPUTS:
            links.new(color, surface.inputs[_INPUTS[role]])
            if role == "emission":
                surface.inputs["Emission Strength"].default_value = 1.0
