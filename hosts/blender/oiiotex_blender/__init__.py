# SPDX-License-Identifier: Apache-2.0
"""A panel of Blender's image editor: the image shown becomes a tile, made by the resident process of oiiotex."""

from __future__ import annotations

import bpy

from .process import Failed, Process

SPACES = {"sRGB": "srgb_rec709_scene", "Linear Rec.709": "lin_rec709_scene", "Non-Color": None}
LINE = "oiiotex"  # the custom property of a result: the line that makes it


class Preferences(bpy.types.AddonPreferences):
    """Which Python has oiiotex."""

    bl_idname = __package__

    python: bpy.props.StringProperty(
        name="Python", subtype="FILE_PATH", default="python3", description="the Python that has oiiotex"
    )

    def draw(self, context):
        """As a field."""
        self.layout.prop(self, "python")


class MakeTile(bpy.types.Operator):
    """Make a tile without visible repetition of the image shown (MJH17)"""

    bl_idname = "oiiotex.make_tile"
    bl_label = "Make Tile"
    bl_options = {"REGISTER", "UNDO"}

    width: bpy.props.IntProperty(name="Width", default=0, min=0, max=16384, description="px; 0: the image's own")
    height: bpy.props.IntProperty(name="Height", default=0, min=0, max=16384, description="px; 0: the image's own")
    seed: bpy.props.IntProperty(name="Seed", default=0, min=0, description="same seed, same pixels")

    @classmethod
    def poll(cls, context):
        """Where an image is shown."""
        return _shown(context) is not None

    def invoke(self, context, event):
        """Begin, and go on while Blender is used; escape cancels."""
        if not self._begun(context):
            return {"CANCELLED"}
        manager = context.window_manager
        manager.progress_begin(0, 100)
        self._timer = manager.event_timer_add(0.1, window=context.window)
        manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context, event):
        """Look whether it is done."""
        if event.type == "ESC":
            self._job.cancel()
        elif event.type == "TIMER":
            context.window_manager.progress_update(100 * self._job.progress)
            if self._job.done:
                context.window_manager.event_timer_remove(self._timer)
                context.window_manager.progress_end()
                return self._ended(context)
        return {"PASS_THROUGH"}

    def execute(self, context):
        """Wait for it: from scripts."""
        if not self._begun(context):
            return {"CANCELLED"}
        self._job.wait()
        return self._ended(context)

    def _begun(self, context) -> bool:
        image = _shown(context)
        try:
            space = SPACES[_space(image)]
        except KeyError:
            self.report({"ERROR"}, f"{image.name}: colour space {_space(image)}: allowed are {', '.join(SPACES)}")
            return False
        self._source = image.name
        values = {"size": f"{self.width or image.size[0]}x{self.height or image.size[1]}", "seed": self.seed}
        values |= {"data": 1} if space is None else {}
        said = "".join(f":{key}={value}" for key, value in values.items())
        self._line = f"oiiotex {image.name}{f' --iscolorspace {space}' if space else ''} --texstationarize{said}"
        preferences = context.preferences.addons.get(__package__)
        process = Process(preferences.preferences.python if preferences else "python3")
        self._job = process.begin("stationarize", _pixels(image), space, values)
        return True

    def _ended(self, context):
        try:
            pixels = self._job.result()
        except Failed as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        source = bpy.data.images[self._source]
        height, width = pixels.shape[:2]
        tile = bpy.data.images.new(f"{source.name} tile", width, height, alpha=True, float_buffer=source.is_float)
        tile.colorspace_settings.name = source.colorspace_settings.name
        tile.pixels.foreach_set(pixels[::-1].ravel())  # Blender's rows begin at the bottom
        tile.update()
        tile.pack()
        tile[LINE] = self._line
        if context.space_data is not None and context.space_data.type == "IMAGE_EDITOR":
            context.space_data.image = tile
        return {"FINISHED"}


class Panel(bpy.types.Panel):
    """Texture"""

    bl_idname = "OIIOTEX_PT_texture"
    bl_label = "Texture"
    bl_space_type = "IMAGE_EDITOR"
    bl_region_type = "UI"
    bl_category = "Texture"

    def draw(self, context):
        """What can be made, and how the image shown was made."""
        self.layout.operator(MakeTile.bl_idname)
        image = _shown(context)
        if image is not None and LINE in image:
            self.layout.label(text=image[LINE])


def _shown(context):
    """The image that the editor shows; from scripts `context.temp_override(edit_image=image)` says it."""
    return getattr(context, "edit_image", None)


def _space(image) -> str:
    """What space `image.pixels` are in: Blender holds float images scene linear."""
    name = image.colorspace_settings.name
    return "Linear Rec.709" if image.is_float and name != "Non-Color" else name


def _pixels(image):
    """(height, width, 4) float32, the top row first."""
    import numpy as np

    pixels = np.empty(image.size[0] * image.size[1] * image.channels, np.float32)
    image.pixels.foreach_get(pixels)
    return np.ascontiguousarray(pixels.reshape(image.size[1], image.size[0], image.channels)[::-1])


_CLASSES = (Preferences, MakeTile, Panel)


def register():
    """Called by Blender."""
    for one in _CLASSES:
        bpy.utils.register_class(one)


def unregister():
    """Called by Blender."""
    for one in reversed(_CLASSES):
        bpy.utils.unregister_class(one)
