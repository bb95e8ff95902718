# SPDX-License-Identifier: Apache-2.0
"""Operators of the panel: each runs an op of oiiotex on the image in the editor."""

from __future__ import annotations

import tempfile
from pathlib import Path

import bpy
import numpy as np
from bpy_extras.io_utils import ExportHelper

from .images import LINE, SOURCE, new_image
from .jobs import Cancel, Making, running, shown, space_of, words_of
from .process import Failed

_MOST_MASKS = 16  # masks of the largest labels
_LATTICE = 0.5  # the default of --texstationarize


class _OneImage(Making):
    """One image from one image; `what` is appended to its name."""

    what: str
    data = False

    def finish(self, context, images, results, line):
        """Create the image."""
        ((_, pixels),) = results[0]
        return [new_image(f"{images[0].name} {self.what}", pixels, line, None if self.data else images[0])]


class Sized:
    """Properties of an operator, or of the panel: size and seed."""

    width: bpy.props.IntProperty(
        name="Width", default=0, min=0, max=16384, description="In pixels; 0: same as the image"
    )
    height: bpy.props.IntProperty(
        name="Height", default=0, min=0, max=16384, description="In pixels; 0: same as the image"
    )
    seed: bpy.props.IntProperty(name="Seed", default=0, min=0, description="Same seed, same pixels")

    def values(self, context, image):
        """Size and seed."""
        return {"size": f"{self.width or image.size[0]}x{self.height or image.size[1]}", "seed": self.seed}


class Tiled(Sized):
    """Properties of an operator that makes tiles, or of the panel."""

    preset: bpy.props.EnumProperty(
        name="Preset",
        items=(
            ("AUTOMATIC", "Automatic", "Values depend on the photo"),
            ("EVEN", "Even", "Large structures are also evened out"),
            ("CLEAN", "Clean", "As Even, and objects are removed"),
            ("LARGE", "Large", "Large structures are preserved"),
        ),
    )
    sigma: bpy.props.FloatProperty(
        name="Sigma",
        default=0.0,
        min=0.0,
        soft_max=512.0,
        description="Scale in pixels above which the result is statistically uniform; 0: chosen by the preset",
    )
    lattice: bpy.props.FloatProperty(
        name="Lattice",
        default=_LATTICE,
        min=0.0,
        max=1.0,
        subtype="FACTOR",
        description="Strength with which regular repeats such as courses of bricks are preserved",
    )

    def values(self, context, image):
        """Size, seed, and what differs from the defaults."""
        values = super().values(context, image)
        if self.preset != "AUTOMATIC":
            values["preset"] = self.preset.lower()
        if self.sigma:
            values["sigma"] = f"{max(0.5, self.sigma):g}"
        if abs(self.lattice - _LATTICE) > 1e-6:
            values["lattice"] = f"{self.lattice:g}"
        return values


class MakeTile(Tiled, _OneImage, bpy.types.Operator):
    """Make a seamless tile without visible repetition from the image (MJH17)"""

    bl_idname = "oiiotex.make_tile"
    bl_label = "Make Tile"
    op, what = "stationarize", "tile"


class NextSeed(bpy.types.Operator):
    """Increase the seed by one, and make another tile of the image"""

    bl_idname = "oiiotex.next_seed"
    bl_label = "Next Seed"

    @classmethod
    def poll(cls, context):
        """Available if the editor shows an image, and no operator is running."""
        return MakeTile.poll(context) and not running

    def invoke(self, context, event):
        """Make it in the background."""
        return self._make(context, "INVOKE_DEFAULT")

    def execute(self, context):
        """Make it and wait."""
        return self._make(context, "EXEC_DEFAULT")

    def _make(self, context, way):
        context.scene.oiiotex.seed += 1
        image = shown(context)
        if LINE in image and SOURCE in image:  # the photo, if a tile is shown
            image = bpy.data.images.get(image[SOURCE], image)
        with context.temp_override(edit_image=image):
            made = bpy.ops.oiiotex.make_tile(way, **settings_of(context, MakeTile))
        return {"FINISHED"} if made & {"FINISHED", "RUNNING_MODAL"} else {"CANCELLED"}


class Flatten(_OneImage, bpy.types.Operator):
    """Remove uneven lighting, gradients and stains from the image"""

    bl_idname = "oiiotex.flatten"
    bl_label = "Flatten"
    op, what = "flatten", "flat"


class DominantMask(_OneImage, bpy.types.Operator):
    """Make a mask of the dominant texture of the image, without other objects (LDR09)"""

    bl_idname = "oiiotex.dominant_mask"
    bl_label = "Dominant Mask"
    op, what, data = "dominant", "dominant", True


class LabelMasks(Making, bpy.types.Operator):
    """Make a mask for each texture in the image, the largest first (LSA16)"""

    bl_idname = "oiiotex.label_masks"
    bl_label = "Label Masks"
    op, parts = "label", "label."

    fine: bpy.props.BoolProperty(name="Fine", default=False, description="Use the finest label map, not the coarsest")

    def finish(self, context, images, results, line):
        """Create the masks."""
        maps = sorted(results[0], key=lambda part: int(part[0].split(".")[1]))
        name, ids = maps[0 if self.fine else -1]
        labels, counts = np.unique(ids[ids > 0], return_counts=True)
        largest = labels[np.argsort(-counts, kind="stable")[:_MOST_MASKS]]
        return [
            new_image(f"{images[0].name} {name} {int(label)}", (ids == label).astype(np.float32), line)
            for label in largest
        ]


class Cryptomatte(ExportHelper, Making, bpy.types.Operator):
    """Write the textures in the image as a Cryptomatte EXR, for the compositor"""

    bl_idname = "oiiotex.cryptomatte"
    bl_label = "Cryptomatte"
    op = "label"
    filename_ext = ".exr"

    def invoke(self, context, event):
        """Ask for the file, then start."""
        if self.filepath:
            return Making.invoke(self, context, event)
        return ExportHelper.invoke(self, context, event)

    def values(self, context, image):
        """Request a Cryptomatte."""
        return {"cryptomatte": 1}

    def begin(self, process, images, spaces, values):
        """Start the program, because Blender reads Cryptomatte layers only from files."""
        file = Path(bpy.path.abspath(images[0].filepath, library=images[0].library))
        if images[0].is_dirty or not file.is_file():
            raise Failed(f"{images[0].name} has unsaved changes or no file; save the image first")
        words = words_of(self.op, images, spaces, values)
        return process.run([str(file), *words[2:], "-o", bpy.path.abspath(self.filepath)])

    def finish(self, context, images, results, line):
        """Load the file as an image."""
        image = bpy.data.images.load(self.filepath, check_existing=True)
        image.reload()
        image[LINE] = line
        return [image]


class MakeMaterial(Tiled, Making, bpy.types.Operator):
    """Make matching tiles of all image maps of the active material, and use them in its nodes"""

    bl_idname = "oiiotex.make_material"
    bl_label = "Make Tiles of Material"
    op = "stationarize"

    @classmethod
    def poll(cls, context):
        """Available if the active material has images."""
        return bool(_nodes(context))

    def maps(self, context, image):
        """The images of the material's nodes, color maps first."""
        images = list(dict.fromkeys(node.image for node in _nodes(context)))
        images.sort(key=lambda one: space_of(one) is None)
        sizes = {tuple(one.size) for one in images}
        if len(sizes) > 1:
            raise Failed(f"the material's images must have the same size: {sorted(sizes)}")
        self._material = context.active_object.active_material.name  # the active material can change meanwhile
        self._shown_by = [(node.name, node.image.name) for node in _nodes(context)]
        return images

    def values(self, context, image):
        """Size and seed, and the kind of each map by the links of its node."""
        images = self.maps(context, image)
        kinds = {node.image: _kind(node) for node in _nodes(context)}
        named = [kinds[one] if space_of(one) is None else "color" for one in images]
        return super().values(context, image) | ({"kinds": ",".join(named)} if images[1:] else {})

    def finish(self, context, images, results, line):
        """Create the tiles, and replace the material's images by them."""
        made = [
            new_image(f"{image.name} tile", parts[0][1], line, image)
            for image, parts in zip(images, results, strict=True)
        ]
        tiles = {image.name: tile for image, tile in zip(images, made, strict=True)}
        material = bpy.data.materials.get(self._material)
        nodes = {} if material is None or material.node_tree is None else material.node_tree.nodes
        for node, image in self._shown_by:
            if node in nodes:
                nodes[node].image = tiles[image]
        return made


class TextureMesh(Sized, Making, bpy.types.Operator):
    """Texture the active object with the image, continuous across UV islands (LDR09 figure 7)"""

    bl_idname = "oiiotex.texture_mesh"
    bl_label = "Texture Mesh"
    op = "atlas"

    @classmethod
    def poll(cls, context):
        """Available if the editor shows an image and a mesh is active."""
        return super().poll(context) and context.active_object is not None and context.active_object.type == "MESH"

    def values(self, context, image):
        """Size, seed, and the mesh as a temporary file."""
        mesh = context.active_object
        if not mesh.data.uv_layers:
            raise Failed(f"{mesh.name} has no UV map; add one, for example with Smart UV Project")
        self._object = mesh.name
        self._folder = tempfile.TemporaryDirectory(prefix="oiiotex")
        path = Path(self._folder.name, f"{bpy.path.clean_name(mesh.name)}.obj")
        _write_obj(mesh.evaluated_get(context.evaluated_depsgraph_get()), path)
        return super().values(context, image) | {"mesh": path}

    def finish(self, context, images, results, line):
        """Create the image, and a material of the object that uses it."""
        image = new_image(f"{images[0].name} on {self._object}", results[0][0][1], line, images[0])
        mesh = bpy.data.objects.get(self._object)
        if mesh is None:
            raise Failed(f"{self._object} has been removed")
        material = bpy.data.materials.new(image.name)
        material.use_nodes = True
        nodes, links = material.node_tree.nodes, material.node_tree.links
        picture = nodes.new("ShaderNodeTexImage")
        picture.image, picture.location = image, (-300, 300)
        surface = next(node for node in nodes if node.type == "BSDF_PRINCIPLED")
        links.new(picture.outputs["Color"], surface.inputs["Base Color"])
        if mesh.data.materials:
            mesh.material_slots[mesh.active_material_index].material = material
        else:
            mesh.data.materials.append(material)
        return [image]


CLASSES = (MakeTile, NextSeed, Cancel, Flatten, DominantMask, LabelMasks, Cryptomatte, MakeMaterial, TextureMesh)


def settings_of(context, operator) -> dict[str, object]:
    """The panel's values of an operator's properties."""
    names = [name for base in operator.__mro__ for name in getattr(base, "__annotations__", ())]
    return {name: getattr(context.scene.oiiotex, name) for name in names if hasattr(context.scene.oiiotex, name)}


def _nodes(context) -> list:
    """The image nodes of the active material."""
    material = getattr(context.active_object, "active_material", None)
    if material is None or material.node_tree is None:
        return []
    return [node for node in material.node_tree.nodes if node.type == "TEX_IMAGE" and node.image is not None]


def _kind(node) -> str:
    """The kind of a data map, from the links of its color output."""
    goes = {link.to_node.type for link in node.outputs["Color"].links}
    return "normal" if "NORMAL_MAP" in goes else "height" if goes & {"DISPLACEMENT", "BUMP"} else "data"


def _write_obj(mesh, path: Path) -> None:
    """Write the evaluated mesh as triangles with UVs."""
    data = mesh.to_mesh()
    data.calc_loop_triangles()
    uvs = data.uv_layers.active.data
    lines = [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in (vertex.co for vertex in data.vertices)]
    lines += [f"vt {u:.9g} {v:.9g}" for u, v in (one.uv for one in uvs)]
    for triangle in data.loop_triangles:
        corners = zip(triangle.vertices, triangle.loops, strict=True)
        lines.append("f " + " ".join(f"{vertex + 1}/{loop + 1}" for vertex, loop in corners))
    mesh.to_mesh_clear()
    path.write_text("\n".join(lines) + "\n")
