# SPDX-License-Identifier: Apache-2.0
"""A panel in Blender's Image Editor that makes textures with the resident process of oiiotex."""

from __future__ import annotations

import textwrap

import bpy

from . import operators, wang
from .images import LINE
from .jobs import running, shown

_MARGIN, _CHARACTER = 50, 7  # px, of the panel and of its text


class Preferences(bpy.types.AddonPreferences):
    """Preferences of the extension."""

    bl_idname = __package__

    python: bpy.props.StringProperty(
        name="Python", subtype="FILE_PATH", default="python3", description="Python executable with oiiotex installed"
    )

    def draw(self, context):
        """Draw the preferences."""
        self.layout.prop(self, "python")


class Settings(operators.Tiled, bpy.types.PropertyGroup):
    """Settings of the panel."""


class Panel(bpy.types.Panel):
    """Texture"""

    bl_idname = "OIIOTEX_PT_texture"
    bl_label = "Texture"
    bl_space_type = "IMAGE_EDITOR"
    bl_region_type = "UI"
    bl_category = "Texture"

    def draw(self, context):
        """Draw settings and buttons, the progress, and the command that made the image."""
        layout, settings = self.layout, context.scene.oiiotex
        layout.use_property_split, layout.use_property_decorate = True, False
        for names in (("preset", "sigma", "lattice"), ("width", "height")):
            column = layout.column(align=True)
            for name in names:
                column.prop(settings, name)
        row = layout.row(align=True)
        row.prop(settings, "seed")
        row.operator(operators.NextSeed.bl_idname, text="", icon="FILE_REFRESH")
        column = layout.column(align=True)
        column.enabled = not running
        for one in (operators.MakeTile, operators.MakeMaterial, operators.TextureMesh):
            button = column.operator(one.bl_idname)
            for name, value in operators.settings_of(context, one).items():
                setattr(button, name, value)
        column = layout.column(align=True)
        column.enabled = not running
        for one in (operators.Flatten, operators.DominantMask, operators.LabelMasks, operators.Cryptomatte):
            column.operator(one.bl_idname)
        layout.operator(wang.WangMaterial.bl_idname)
        if running:
            job, row = running["job"], layout.row(align=True)
            row.progress(factor=job.progress, text=f"{running['label']}: {100 * job.progress:.0f} %")
            row.operator(operators.Cancel.bl_idname, text="", icon="X")
        image = shown(context)
        if image is not None and LINE in image:
            column = layout.column(align=True)
            column.scale_y = 0.7
            width = context.region.width / context.preferences.system.ui_scale - _MARGIN
            for line in textwrap.wrap(image[LINE], max(16, int(width / _CHARACTER)), break_on_hyphens=False):
                column.label(text=line)


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
