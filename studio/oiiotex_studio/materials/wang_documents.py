# SPDX-License-Identifier: Apache-2.0
"""MaterialX documents of a material that is an atlas of Wang tiles.

The graph consists of standard nodes: the cell of a coordinate, its tile in the index image, the place in the atlas.
Raster languages measure derivatives between pixels, and the place jumps at borders of tiles. So the maps are read by
a node of our own, whose graph is the standard `image` and whose GLSL takes the derivatives of the unbroken coordinate.
Derivatives in OSL and MDL are analytic, and that of `floor` is 0, so the graph is right there.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..api.files import written
from ..api.materials import CELLS, ROUGHNESS
from .documents import (
    OPENPBR_INPUTS,
    SPACES,
    STANDARD,
    connect_heights,
    loaded_libraries,
    materialx,
    opengl_normals,
    write_valid,
)
from .nodes import node_of

IMAGE = "oiiotex_image"  # the node
_SWIZZLES = {"float": ("float", "r"), "color3": ("vec3", "rgb"), "vector3": ("vec3", "rgb")}
_GLSL = """\
// SPDX-License-Identifier: Apache-2.0
// mx_transform_uv, which flips images for some hosts, comes with the node that reads the index image before this one
void {name}($texSamplerSignature, vec2 texcoord, vec2 span, out {kind} result)
{{
    vec2 uv = mx_transform_uv(texcoord, vec2(1.0), vec2(0.0));
    result = textureGrad($texSamplerSampler2D, uv, dFdx(span), dFdy(span)).{channels};
}}
"""


@dataclass(frozen=True)
class WangMaterial:
    """A material whose maps are atlases of the same layout.

    Attributes
    ----------
    identifier : str
        Name of its nodes.
    maps : mapping of role to str
        Files of the atlases, relative to the document.
    index : str
        File of the index image.
    side : int
        Tiles along a side of an atlas.
    space : str
        Color space of color maps.
    hand : str
        Convention of normals: 'opengl', 'directx' or ''.
    tile_m : (float, float)
        Width and height of a tile in units of texture coordinates.
    relief : float
        Distance between heights 0 and 1 in units of the scene; 0: the height is not connected.
    """

    identifier: str
    maps: Mapping[str, str]
    index: str
    side: int
    space: str
    hand: str
    tile_m: tuple[float, float]
    relief: float


def write_wang_materialx(material: WangMaterial, path: Path) -> list[Path]:
    """Write the document, the one of standard nodes alone (NAME_standard.mtlx), and GLSL files; returns all paths.

    Raises
    ------
    Error
        MaterialX is not installed, or rejects a document.
    """
    paths = [path]
    document = _document(material, own_node=True)
    write_valid(document, path)
    for kind, (result, channels) in _SWIZZLES.items():
        name = f"{IMAGE}_{kind}"
        paths.append(path.with_name(f"{name}.glsl"))
        with written(paths[-1]) as file:
            file.write(_GLSL.format(name=name, kind=result, channels=channels).encode())
    paths.append(path.with_name(f"{path.stem}{STANDARD}.mtlx"))
    write_valid(_translated(_document(material, own_node=False), material.identifier), paths[-1])
    return paths


def _translated(document: Any, name: str) -> Any:
    """The document with a standard_surface instead of OpenPBR, for hosts that know neither it nor its translation."""
    from MaterialX import PyMaterialXGenShader as shaders

    document.importLibrary(loaded_libraries())  # the translator looks for shaders in the document itself
    shaders.ShaderTranslator.create().translateAllMaterials(document, "standard_surface")
    graph = document.getNodeGraph(f"maps_{name}")
    graph.flattenSubgraphs("", lambda node: node.getCategory().startswith("open_pbr_surface_to_"))
    surface = document.getNode(f"surface_{name}")
    if graph.getOutput("normal"):
        _connect(surface, "normal", "vector3", graph, "normal")  # MaterialX 1.39 does not translate it
    own = materialx().createDocument()
    own.copyContentFrom(document)
    for child in document.getChildren():
        if child.hasSourceUri():  # of the libraries
            own.removeChild(child.getName())
    own.setDataLibrary(loaded_libraries())
    return own


def _document(material: WangMaterial, own_node: bool) -> Any:
    """The document; without the node of our own, maps are read by `image`."""
    mx = materialx()
    document = mx.createDocument()
    document.setColorSpace("lin_rec709")
    document.setDataLibrary(loaded_libraries())
    if own_node:
        for kind in _SWIZZLES:
            _define(document, kind)
    name = material.identifier
    graph = document.addNodeGraph(f"maps_{name}")
    place, span = _places(graph, material)
    surface = document.addNode("open_pbr_surface", f"surface_{name}", "surfaceshader")
    target = document.addMaterialNode(name, surface)
    for role, file in material.maps.items():
        kind = OPENPBR_INPUTS[role][1] if role in OPENPBR_INPUTS else "float"
        node = graph.addNode(IMAGE if own_node else "image", f"{role}_image", kind)
        source = node.addInput("file", "filename")
        source.setValueString(file)
        color = kind == "color3"
        source.setColorSpace(SPACES.get(material.space, material.space) if color else "none")
        node.addInput("texcoord", "vector2").setConnectedNode(place)
        if own_node:
            node.addInput("span", "vector2").setConnectedNode(span)
        if role == "normal":
            node = opengl_normals(graph, node, material.hand)
        elif role == "gloss":
            node = node_of(graph, "invert", "roughness_of_gloss", kind, {"in": node})
        graph.addOutput(role, kind).setConnectedNode(node)
        known = "roughness" if role == "gloss" and "roughness" not in material.maps else role
        if known in OPENPBR_INPUTS:
            _connect(surface, OPENPBR_INPUTS[known][0], kind, graph, role)
    if not {"roughness", "gloss"} & set(material.maps):
        surface.setInputValue("specular_roughness", ROUGHNESS)
    if "emission" in material.maps:
        surface.setInputValue("emission_luminance", 1.0)
    if "height" in material.maps:
        connect_heights(document, target, graph, name, material.relief)
    return document


def _connect(node: Any, name: str, kind: str, graph: Any, output: str) -> None:
    target = node.addInput(name, kind)
    target.setNodeGraphString(graph.getName())
    target.setOutputString(output)


def _places(graph: Any, material: WangMaterial) -> tuple[Any, Any]:
    """The place in the atlas, with v upwards, and the coordinate in atlases, which is continuous."""
    mx = materialx()

    def of(category: str, name: str, first: Any, second: Any, kind: str = "vector2") -> Any:
        node = node_of(graph, category, name, kind, {"in1": first})
        if isinstance(second, tuple):
            node.setInputValue("in2", mx.Vector2(*second))
        else:
            node.addInput("in2", second.getType()).setConnectedNode(second)
        return node

    uv = graph.addNode("texcoord", "uv", "vector2")
    width, height = material.tile_m
    side = material.side
    tiles = of("multiply", "in_tiles", uv, (1 / width, -1 / height))  # v downwards, as in images
    cell = node_of(graph, "floor", "cell", "vector2", {"in": tiles})
    inside = of("subtract", "inside_tile", tiles, cell)
    center = of("add", "cell_center", cell, (0.5, 0.5))
    where = of("multiply", "place_in_index", center, (1 / CELLS, -1 / CELLS))
    index = graph.addNode("image", "index_image", "vector3")
    source = index.addInput("file", "filename")
    source.setValueString(material.index)
    source.setColorSpace("none")
    index.addInput("texcoord", "vector2").setConnectedNode(where)
    for name, value in (("filtertype", "closest"), ("uaddressmode", "periodic"), ("vaddressmode", "periodic")):
        index.addInput(name, "string").setValueString(value)
    channels = []
    for number, name in enumerate(("column", "row")):
        channels.append(node_of(graph, "extract", name, "float", {"in": index}))
        channels[-1].setInputValue("index", number)
    tile = of("combine2", "tile_255", *channels)
    corner = of("multiply", "tile", tile, (255.0, 255.0))
    in_atlas = of("add", "place_in_tiles", corner, inside)
    place = of("multiply", "place_in_atlas", in_atlas, (1 / side, -1 / side))
    return place, of("multiply", "span", tiles, (1 / side, 1 / side))


def _define(document: Any, kind: str) -> None:
    """Define the node for a type: its graph, and its GLSL, from which MaterialX derives Metal, Slang and WGSL."""
    name = f"{IMAGE}_{kind}"
    definition = document.addNodeDef(f"ND_{name}", kind, IMAGE)
    definition.setNodeGroup("texture2d")
    definition.addInput("file", "filename").setIsUniform(True)
    for port in ("texcoord", "span"):
        definition.addInput(port, "vector2").setValueString("0, 0")
    graph = document.addNodeGraph(f"NG_{name}")
    graph.setNodeDefString(definition.getName())
    image = graph.addNode("image", "read_image", kind)
    for port, port_kind in (("file", "filename"), ("texcoord", "vector2")):
        image.addInput(port, port_kind).setInterfaceName(port)
    graph.addOutput("out", kind).setConnectedNode(image)
    code = document.addImplementation(f"IM_{name}_genglsl")
    code.setNodeDefString(definition.getName())
    code.setTarget("genglsl")
    code.setFile(f"{name}.glsl")
    code.setFunction(name)
