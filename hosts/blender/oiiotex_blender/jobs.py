# SPDX-License-Identifier: Apache-2.0
"""Operators that run an op in the background, and the one that cancels them."""

from __future__ import annotations

import shlex
from pathlib import Path

import bpy

from .images import SPACES, name_of_space, pixels_of
from .process import CANCELED, CHANNELS, Failed, Process

running = {}  # label and job of the running operator, for the panel


class Making:
    """An operator that runs an op in the background; Esc cancels it.

    Attributes
    ----------
    op : str
        Name of the op, without `--tex`.
    parts : str or None
        Prefix of the names of the parts to read; None: the first part of each result.
    """

    bl_options = {"REGISTER", "UNDO"}
    op: str
    parts: str | None = None

    @classmethod
    def poll(cls, context):
        """Available if the editor shows an image."""
        return shown(context) is not None

    def values(self, context, image) -> dict[str, object]:
        """The op's modifiers."""
        return {}

    def maps(self, context, image) -> list:
        """The input images."""
        return [image]

    def begin(self, process, images, spaces, values):
        """Start the job."""
        maps = [(pixels_of(image), space) for image, space in zip(images, spaces, strict=True)]
        return process.begin(self.op, maps, values, self.parts)

    def finish(self, context, images, results, line) -> list:
        """Create Blender images from the results."""
        raise NotImplementedError

    def invoke(self, context, event):
        """Start in the background."""
        if running:
            self.report({"WARNING"}, f"{running['label']} is still running")
            return {"CANCELLED"}
        if not self._begun(context):
            return {"CANCELLED"}
        running.update(label=self.bl_label, job=self._job)
        manager = context.window_manager
        self._timer = manager.event_timer_add(0.1, window=context.window)
        manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context, event):
        """Handle Esc, and check whether the job has ended."""
        if event.type == "ESC":
            self._job.cancel()
        elif event.type == "TIMER":
            context.workspace.status_text_set(f"{self.bl_label}: {100 * self._job.progress:.0f} % (Esc to cancel)")
            for area in context.screen.areas:  # the panel shows the progress
                if area.type == "IMAGE_EDITOR":
                    area.tag_redraw()
            if self._job.done:
                self._stop(context)
                return self._ended(context)
        return {"PASS_THROUGH"}

    def cancel(self, context):
        """Called by Blender when it ends the operator, as it does to open a file."""
        self._job.cancel()
        self._stop(context)

    def _stop(self, context) -> None:
        context.window_manager.event_timer_remove(self._timer)
        context.workspace.status_text_set(None)
        running.clear()

    def execute(self, context):
        """Run and wait: called from scripts and by Adjust Last Operation."""
        if not self._begun(context):
            return {"CANCELLED"}
        self._job.wait()
        return self._ended(context)

    def _begun(self, context) -> bool:
        try:
            images = self.maps(context, shown(context))
            spaces = [space_of(image) for image in images]
            values = self.values(context, images[0])
            self._line = " ".join(shlex.quote(word) for word in words_of(self.op, images, spaces, values))
            preferences = context.preferences.addons.get(__package__)
            process = Process(preferences.preferences.python if preferences else "python3")
            self._job = self.begin(process, images, spaces, values)
        except Failed as error:
            self.report({"ERROR"}, str(error))
            return False
        self._names = [image.name for image in images]  # images can be removed meanwhile
        return True

    def _ended(self, context):
        try:
            results = self._job.result()
            missing = [name for name in self._names if name not in bpy.data.images]
            if missing:
                raise Failed(f"{missing[0]} has been removed")
            made = self.finish(context, [bpy.data.images[name] for name in self._names], results, self._line)
        except Failed as error:
            self.report({"INFO" if str(error) == CANCELED else "ERROR"}, str(error))
            return {"CANCELLED"}
        for text in self._job.warnings:
            self.report({"WARNING"}, text)
        if context.space_data is not None and context.space_data.type == "IMAGE_EDITOR":
            context.space_data.image = made[0]
        return {"FINISHED"}


class Cancel(bpy.types.Operator):
    """Cancel the running operation"""

    bl_idname = "oiiotex.cancel"
    bl_label = "Cancel"

    def execute(self, context):
        """Cancel the job."""
        if running:
            running["job"].cancel()
        return {"FINISHED"}


def shown(context):
    """The image in the editor; scripts set it with `context.temp_override(edit_image=image)`."""
    return getattr(context, "edit_image", None)


def space_of(image) -> str | None:
    """The color space of an image, as oiiotex names it; None for data."""
    if not image.size[0] or image.channels not in CHANNELS:
        raise Failed(f"{image.name} has no readable pixels; its file may be missing")
    name = name_of_space(image)
    if name not in SPACES:
        raise Failed(f"{image.name}: color space {name}: expected {', '.join(SPACES)}")
    return SPACES[name]


def words_of(op, images, spaces, values) -> list[str]:
    """The command of a result. Adds `data` to `values` if the first image is data."""
    if spaces[0] is None:
        values["data"] = 1
    words = ["oiiotex"]
    for image, space in zip(images, spaces, strict=True):
        words += [image.name, *(["--iscolorspace", space] if space else [])]
    said = {key: value.name if isinstance(value, Path) else value for key, value in values.items()}
    return [*words, f"--tex{op}" + "".join(f":{key}={value}" for key, value in said.items())]
