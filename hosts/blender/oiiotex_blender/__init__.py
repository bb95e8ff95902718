# SPDX-License-Identifier: Apache-2.0
"""A panel in Blender's Image Editor that makes textures with the resident process of oiiotex."""

from __future__ import annotations

import bpy

from . import operators, wang
from .images import LINE


class Preferences(bpy.types.AddonPreferences):
    """Preferences of the extension."""

    bl_idname = __package__

    python: bpy.props.StringProperty(
        name="Python", subtype="FILE_PATH", default="python3", description="Python executable with oiiotex installed"
    )

    def draw(self, context):
        """Draw the preferences."""
        self.layout.prop(self, "python")


class Settings(bpy.types.PropertyGroup):
    """Settings of the panel."""

    width: bpy.props.IntProperty(name="Width", default=0, min=0, max=16384, description="In pixels; 0: as the image")
    height: bpy.props.IntProperty(name="Height", default=0, min=0, max=16384, description="In pixels; 0: as the image")
    seed: bpy.props.IntProperty(name="Seed", default=0, min=0, description="Same seed, same pixels")


class Panel(bpy.types.Panel):
    """Texture"""

    bl_idname = "OIIOTEX_PT_texture"
    bl_label = "Texture"
    bl_space_type = "IMAGE_EDITOR"
    bl_region_type = "UI"
    bl_category = "Texture"

    def draw(self, context):
        """Draw settings and buttons, and the command that made the image."""
        layout, settings = self.layout, context.scene.oiiotex
        column = layout.column(align=True)
        for name in ("width", "height", "seed"):
            column.prop(settings, name)
        for one in (operators.MakeTile, operators.MakeMaterial, operators.TextureMesh):
            button = layout.operator(one.bl_idname)
            button.width, button.height, button.seed = settings.width, settings.height, settings.seed
        column = layout.column(align=True)
        for one in (operators.Flatten, operators.DominantMask, operators.LabelMasks, operators.Cryptomatte):
            column.operator(one.bl_idname)
        layout.operator(wang.WangMaterial.bl_idname)
        image = operators.shown(context)
        if image is not None and LINE in image:
            layout.label(text=image[LINE])


_CLASSES = (Preferences, Settings, *operators.CLASSES, wang.WangMaterial, Panel)


def register():
    """Called by Blender."""
    for one in _CLASSES:
        bpy.utils.register_class(one)
    bpy.types.Scene.oiiotex = bpy.props.PointerProperty(type=Settings)


def unregister():
    """Called by Blender."""
    del bpy.types.Scene.oiiotex
    for one in reversed(_CLASSES):
        bpy.utils.unregister_class(one)
