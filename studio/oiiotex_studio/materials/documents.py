# SPDX-License-Identifier: Apache-2.0
"""Documents of a material for other programs: MaterialX and USD."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from oiiotex.engine.errors import Error, reason_of

from ..api.files import checked_name
from ..api.materials import ROUGHNESS
from .hexagons import HexMap
from .naming import COLORS
from .nodes import Hexagons, node_of

if TYPE_CHECKING:
    import MaterialX


STANDARD = "_standard"  # suffix of the document for hosts without OpenPBR
HEX = "_hextiled"  # suffix of the hex-tiled material's name
SPACES = {  # MaterialX names of common color spaces
    "srgb_rec709_scene": "srgb_texture", "lin_rec709_scene": "lin_rec709", "ACEScg": "acescg",
    "lin_ap1_scene": "acescg",
}  # fmt: skip
_STANDARD_INPUTS = {  # inputs of standard_surface, with their types
    "color": ("base_color", "color3"), "roughness": ("specular_roughness", "float"), "metal": ("metalness", "float"),
    "normal": ("normal", "vector3"), "opacity": ("opacity", "color3"), "emission": ("emission_color", "color3"),
    "specular": ("specular_color", "color3"),
}  # fmt: skip
OPENPBR_INPUTS = _STANDARD_INPUTS | {  # those of OpenPBR that differ
    "metal": ("base_metalness", "float"), "normal": ("geometry_normal", "vector3"),
    "opacity": ("geometry_opacity", "float"),
}  # fmt: skip
_SURFACES = {  # suffix of a document: its surface, inputs, and strength of emission
    "": ("open_pbr_surface", OPENPBR_INPUTS, "emission_luminance"),
    STANDARD: ("standard_surface", _STANDARD_INPUTS, "emission"),
}
_PREVIEW = {  # inputs of UsdPreviewSurface, with type and channels
    "color": ("diffuseColor", "Color3f", "rgb"), "roughness": ("roughness", "Float", "r"),
    "metal": ("metallic", "Float", "r"), "normal": ("normal", "Normal3f", "rgb"), "opacity": ("opacity", "Float", "r"),
    "ao": ("occlusion", "Float", "r"), "emission": ("emissiveColor", "Color3f", "rgb"),
    "height": ("displacement", "Float", "r"),
}  # fmt: skip


@dataclass(frozen=True)
class Described:
    """The description of an asset for its documents.

    Attributes
    ----------
    name : str
    maps : mapping of role to str
        Files, relative to the asset's folder.
    space : str
        Color space of its color maps.
    hand : str
        Convention of its normals: 'opengl', 'directx' or ''.
    hexes : mapping of role to (str, HexMap)
        File of each map but the normals for a plane of hexagons, and its table. Empty: no such plane.
    tile_m : (float, float)
        Width and height of the maps in units of texture coordinates.
    relief : float
        Distance between heights 0 and 1; 0: heights are not connected.
    """

    name: str
    maps: Mapping[str, str]
    space: str
    hand: str
    hexes: Mapping[str, tuple[str, HexMap]] = field(default_factory=dict)
    tile_m: tuple[float, float] = (1.0, 1.0)
    relief: float = 0.0

    def __post_init__(self) -> None:
        checked_name(self.name, "material")

    @property
    def identifier(self) -> str:
        """The name with only letters, digits and underscores."""
        name = "".join(c if c.isascii() and c.isalnum() else "_" for c in self.name)
        return name if name[:1].isalpha() else f"m_{name}"


# --- MaterialX ---


def write_materialx(described: Described, folder: Path) -> None:
    """Write NAME.mtlx with OpenPBR, and NAME_standard.mtlx with standard_surface.

    Each has a material that repeats the tile and, with `hexes`, a second one that is a plane of hexagons.

    Raises
    ------
    Error
        MaterialX is not installed, or rejects the document.
    """
    for suffix in _SURFACES:
        document = materialx().createDocument()
        document.setColorSpace("acescg" if SPACES.get(described.space) == "acescg" else "lin_rec709")  # of shading
        document.setDataLibrary(loaded_libraries())
        _material(document, described, suffix, hex_tiled=False)
        if described.hexes:
            _material(document, described, suffix, hex_tiled=True)
        write_valid(document, folder / f"{described.name}{suffix}.mtlx")


def write_valid(document: MaterialX.Document, path: Path) -> None:
    """Write a document that MaterialX accepts."""
    valid, text = document.validate()
    if not valid:
        raise Error(f"{path.name}: {text}")
    materialx().writeToXmlFile(document, str(path))


def materialx_faults(path: Path) -> list[str]:
    """Errors in a file: those of MaterialX's validator, and missing files."""
    mx = materialx()
    document = mx.createDocument()
    try:
        mx.readFromXmlFile(document, str(path))
        document.setDataLibrary(loaded_libraries())
        valid, text = document.validate()
        files = [
            path.parent / element.getValueString()
            for element in document.traverseTree()
            if element.isA(mx.Input) and element.getType() == "filename" and element.getValueString()
        ]
    except Exception as error:  # MaterialX exceptions, and those of bytes that are not UTF-8
        return [f"{path}: {reason_of(error)}"]
    faults = [] if valid else [f"{path}: {text}"]
    return faults + [f"{path}: {file} is missing" for file in files if not os.path.isfile(file)]


def has_materialx() -> bool:
    """Whether MaterialX is installed."""
    try:
        materialx()
    except Error:
        return False
    return True


def materialx() -> Any:
    """The module; raises Error if it is not installed."""
    try:
        import MaterialX
    except ImportError as error:
        advice = "run pip install oiiotex-studio[library], or set materialx = false in the recipe"
        raise Error(f"MaterialX is not installed: {advice}") from error
    return MaterialX


_loaded: list[Any] = []


def loaded_libraries() -> Any:
    """The standard node libraries, loaded once."""
    if not _loaded:
        mx = materialx()
        library = mx.createDocument()
        mx.loadLibraries(mx.getDefaultDataLibraryFolders(), mx.getDefaultDataSearchPath(), library)
        _loaded.append(library)
    return _loaded[0]


def _material(document: MaterialX.Document, described: Described, suffix: str, hex_tiled: bool) -> None:
    category, inputs, emission = _SURFACES[suffix]
    name = described.identifier + HEX * hex_tiled
    graph = document.addNodeGraph(f"maps_{name}")
    surface = document.addNode(category, f"surface_{name}", "surfaceshader")
    hexagons = Hexagons(graph, described.tile_m) if hex_tiled else None
    maps = dict(described.maps)
    inverted = "gloss" in maps and "roughness" not in maps
    if inverted:
        maps["roughness"] = maps.pop("gloss")
    for role, file in maps.items():
        kind = inputs[role][1] if role in inputs else "float"
        if hexagons and role == "normal":
            node = opengl_normals(graph, hexagons.mean(role, file, kind), described.hand)
        elif hexagons:
            node = _of_hexagons(hexagons, graph, role, kind, described)
        elif role == "normal":
            node = _normals(graph, file, described.hand)
        else:
            node = _texture(graph, role, file, kind, described)
        if role == "roughness" and inverted:
            node = node_of(graph, "invert", "roughness_of_gloss", kind, {"in": node})
        output = graph.addOutput(role, kind)
        output.setConnectedNode(node)
        if role in inputs:
            target = surface.addInput(inputs[role][0], kind)
            target.setNodeGraphString(graph.getName())
            target.setOutputString(role)
    if "emission" in maps:
        surface.setInputValue(emission, 1.0)
    if "roughness" not in maps:
        surface.setInputValue("specular_roughness", ROUGHNESS)
    target = document.addMaterialNode(name, surface)
    if "height" in maps:
        connect_heights(document, target, graph, name, described.relief)


def connect_heights(document: Any, material: Any, graph: Any, name: str, relief: float) -> None:
    """Displace a material by the output `height` of a graph; `relief`: distance between 0 and 1, or 0 for none."""
    if relief:
        moved = document.addNode("displacement", f"displacement_{name}", "displacementshader")
        target = moved.addInput("displacement", "float")
        target.setNodeGraphString(graph.getName())
        target.setOutputString("height")
        moved.setInputValue("scale", relief)
        material.addInput("displacementshader", "displacementshader").setConnectedNode(moved)


def _texture(graph: Any, role: str, file: str, kind: str, described: Described) -> Any:
    """The node that reads a map."""
    node = graph.addNode("image", f"{role}_image", kind)
    source = node.addInput("file", "filename")
    source.setValueString(file)
    if role in COLORS:
        source.setColorSpace(SPACES.get(described.space, described.space))
    else:
        source.setColorSpace("none")
    return node


def _of_hexagons(hexagons: Hexagons, graph: Any, role: str, kind: str, described: Described) -> Any:
    """The node of a map on a plane of hexagons."""
    file, tile = described.hexes["gloss" if role == "roughness" and role not in described.maps else role]
    node = hexagons.blended(role, file, tile)
    if node.getType() == kind:
        return node
    if kind == "float":
        node = node_of(graph, "extract", f"{role}_gray", kind, {"in": node})
        node.setInputValue("index", 0)
        return node
    return node_of(graph, "convert", f"{role}_converted", kind, {"in": node})


def _normals(graph: Any, file: str, hand: str) -> Any:
    """The node that reads a normal map; MaterialX uses the OpenGL convention."""
    image = graph.addNode("image", "normal_image", "vector3")
    source = image.addInput("file", "filename")
    source.setValueString(file)
    source.setColorSpace("none")
    return opengl_normals(graph, image, hand)


def opengl_normals(graph: Any, image: Any, hand: str) -> Any:
    """The normals of the texels that a node reads."""
    if hand == "directx":
        mx = materialx()
        turned = node_of(graph, "multiply", "normal_turned", "vector3", {"in1": image})
        turned.setInputValue("in2", mx.Vector3(1, -1, 1))
        image = node_of(graph, "add", "normal_upwards", "vector3", {"in1": turned})
        image.setInputValue("in2", mx.Vector3(0, 1, 0))
    return node_of(graph, "normalmap", "normal_bumps", "vector3", {"in": image})


# --- USD ---


def write_usd(described: Described, folder: Path) -> None:
    """Write NAME.usda: the variant set 'shading' has UsdPreviewSurface, and the MaterialX document through UsdMtlx.

    The MaterialX variant requires the plugin UsdMtlx, which usd-core from PyPI lacks.

    Raises
    ------
    Error
        usd-core is not installed.
    """
    try:
        from pxr import Gf, Sdf, Usd, UsdGeom, UsdShade
    except ImportError as error:
        raise Error("usd-core is not installed: pip install usd-core") from error
    path = folder / f"{described.name}.usda"
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    root = f"/{described.identifier}"
    material = UsdShade.Material.Define(stage, root)
    stage.SetDefaultPrim(material.GetPrim())
    variants = material.GetPrim().GetVariantSets().AddVariantSet("shading")
    for name in ("materialx", "preview"):
        variants.AddVariant(name)
    variants.SetVariantSelection("preview")
    if (folder / f"{described.name}.mtlx").is_file():  # not selected, because USD without UsdMtlx warns
        source = Sdf.Reference(f"./{described.name}.mtlx", f"/MaterialX/Materials/{described.identifier}")
        Sdf.CreatePrimInLayer(stage.GetRootLayer(), f"{root}{{shading=materialx}}").referenceList.Prepend(source)
    with variants.GetVariantEditContext():
        shader = UsdShade.Shader.Define(stage, f"{root}/preview")
        shader.CreateIdAttr("UsdPreviewSurface")
        reader = UsdShade.Shader.Define(stage, f"{root}/st")
        reader.CreateIdAttr("UsdPrimvarReader_float2")
        reader.CreateInput("varname", Sdf.ValueTypeNames.String).Set("st")
        st = reader.CreateOutput("result", Sdf.ValueTypeNames.Float2)
        if described.tile_m != (1.0, 1.0):
            scaled = UsdShade.Shader.Define(stage, f"{root}/scaled_st")
            scaled.CreateIdAttr("UsdTransform2d")
            scaled.CreateInput("in", Sdf.ValueTypeNames.Float2).ConnectToSource(st)
            scale = Gf.Vec2f(*(1 / n for n in described.tile_m))
            scaled.CreateInput("scale", Sdf.ValueTypeNames.Float2).Set(scale)
            st = scaled.CreateOutput("result", Sdf.ValueTypeNames.Float2)
        for role, file in described.maps.items():
            inverted = role == "gloss" and "roughness" not in described.maps
            role = "roughness" if inverted else role
            if role not in _PREVIEW or (role == "height" and not described.relief):
                continue
            name, kind, channels = _PREVIEW[role]
            texture = UsdShade.Shader.Define(stage, f"{root}/{role}")
            texture.CreateIdAttr("UsdUVTexture")
            texture.CreateInput("file", Sdf.ValueTypeNames.Asset).Set(f"./{file}")
            texture.CreateInput("st", Sdf.ValueTypeNames.Float2).ConnectToSource(st)
            space = "sRGB" if role in COLORS and described.space.startswith("srgb") else "raw"
            texture.CreateInput("sourceColorSpace", Sdf.ValueTypeNames.Token).Set(space)
            for wrap in ("wrapS", "wrapT"):
                texture.CreateInput(wrap, Sdf.ValueTypeNames.Token).Set("repeat")
            scale, bias = _range(role, described, inverted)
            if scale is not None:
                texture.CreateInput("scale", Sdf.ValueTypeNames.Float4).Set(Gf.Vec4f(*scale))
                texture.CreateInput("bias", Sdf.ValueTypeNames.Float4).Set(Gf.Vec4f(*bias))
            kinds = {"rgb": Sdf.ValueTypeNames.Float3, "r": Sdf.ValueTypeNames.Float}
            output = texture.CreateOutput(channels, kinds[channels])
            shader.CreateInput(name, getattr(Sdf.ValueTypeNames, kind)).ConnectToSource(output)
        if not {"roughness", "gloss"} & set(described.maps):
            shader.CreateInput("roughness", Sdf.ValueTypeNames.Float).Set(ROUGHNESS)
        surface = shader.CreateOutput("surface", Sdf.ValueTypeNames.Token)
        material.CreateSurfaceOutput().ConnectToSource(surface)
    stage.GetRootLayer().Save()


def usd_faults(path: Path) -> list[str]:
    """Errors that USD's validators find in a stage and its variants; empty if there are no validators.

    The MaterialX variant is checked only if USD has the plugin UsdMtlx.
    """
    try:
        from pxr import Sdf, Usd, UsdValidation
    except ImportError:
        return []
    context = UsdValidation.ValidationContext(UsdValidation.ValidationRegistry().GetOrLoadAllValidators())
    try:
        stage = Usd.Stage.Open(str(path))
    except Exception as error:  # USD exceptions
        return [f"{path}: {reason_of(error)}"]
    stage.SetEditTarget(stage.GetSessionLayer())  # do not change the file
    variants = stage.GetDefaultPrim().GetVariantSet("shading") if stage.HasDefaultPrim() else None
    if not variants:
        return [f"{path} has no material with the variant set shading"]
    messages = []
    for name in ("preview", *(["materialx"] if Sdf.FileFormat.FindByExtension("mtlx") else [])):
        variants.SetVariantSelection(name)
        messages += [f"{path}: {error.GetMessage()}" for error in context.Validate(stage)]
    return messages


def _range(role: str, described: Described, inverted: bool) -> tuple[tuple[float, ...] | None, tuple[float, ...]]:
    """Scale and bias of texel values; (None, ()) for none."""
    if role == "normal":  # UsdPreviewSurface expects -1..1, y up
        y = -1 if described.hand == "directx" else 1
        return (2, 2 * y, 2, 1), (-1, -y, -1, 0)
    if role == "height":
        return (described.relief,) * 3 + (1,), (0, 0, 0, 0)
    if inverted:
        return (-1, -1, -1, 1), (1, 1, 1, 0)
    return None, ()
