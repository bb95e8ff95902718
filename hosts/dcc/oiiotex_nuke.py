# SPDX-License-Identifier: Apache-2.0
"""Nuke: tiles, moving tiles, label mattes and Wang planes. In menu.py: `import oiiotex_nuke; oiiotex_nuke.menu()`."""

from __future__ import annotations

import os
from pathlib import Path

import nuke
from oiiotex_line import literal, run, tile_line

_EVALUATED = '[]$`\\"{}'  # in a text of a knob, which is Tcl
_BLINK = Path(__file__).with_name("wang_plane.blink")


def make_tile():
    """Make a tile of the selected Read node's file, and nodes that show and repeat it."""
    read = nuke.selectedNode()
    photo = _file_of(read)
    if photo is None:
        return None
    panel = nuke.Panel("Make Tile")
    panel.addSingleLineInput("Seed", "0")
    panel.addEnumerationPulldown("Preset", "automatic even clean large layout")
    panel.addSingleLineInput("Color space", "")
    if not panel.show():
        return None
    preset, space = panel.value("Preset"), panel.value("Color space")
    given = {"seed": panel.value("Seed")} | ({} if preset == "automatic" else {"preset": preset})
    out = os.path.splitext(photo)[0] + "_tile"
    words, files = tile_line({"color": photo}, out, space=space or None, st=f"{out}_st.exr", **given)
    try:
        run(words)
    except RuntimeError as error:
        nuke.message(str(error))
        return None
    tile = nuke.nodes.Read(file=files["color"], label=_escaped("\n".join(words)))
    nuke.nodes.Tile(inputs=[tile], rows=3, columns=3)
    return apply_coordinates(read, f"{out}_st.exr")


def apply_coordinates(picture, path):
    """The tile of another picture of the photo's size, by the source coordinates of a tile.

    The coordinates count from the top; STMap counts from the bottom. Neighboring coordinates can be far apart in the
    picture, so no filter may interpolate between them.
    """
    coordinates = nuke.nodes.Read(file=literal(path, _EVALUATED), raw=True)
    flipped = nuke.nodes.Expression(inputs=[coordinates], expr0="r", expr1="1 - g")
    return nuke.nodes.STMap(inputs=[picture, flipped], uv="rgb", filter="Impulse")


def pick_labels():
    """Write the labels of the selected Read node's file as a Cryptomatte, and make a node to pick from it."""
    photo = _file_of(nuke.selectedNode())
    if photo is None:
        return None
    out = os.path.splitext(photo)[0] + "_labels.exr"
    try:
        run([os.environ.get("OIIOTEX", "oiiotex"), photo, "--texlabel:cryptomatte=1:onepart=1", "-o", out])
    except RuntimeError as error:
        nuke.message(str(error))
        return None
    return nuke.nodes.Cryptomatte(inputs=[nuke.nodes.Read(file=out, raw=True)])


def wang_plane():
    """A plane of Wang tiles from an atlas and its index image, of `oiiotex-library wang`."""
    index = _literal(nuke.getFilename("NAME_index.png", "*_index.png"))
    if not index:
        return None
    atlas = nuke.nodes.Read(file=index.replace("_index.", "_color."))
    cells = nuke.nodes.Read(file=index, raw=True)
    plane = nuke.nodes.Constant(format="2048 2048 0 0 2048 2048 1 wang_plane", channels="rgba")
    node = nuke.nodes.BlinkScript(inputs=[plane, atlas, cells])
    node["kernelSource"].setValue(_BLINK.read_text())
    node["recompile"].execute()  # type: ignore[attr-defined]  # a button
    return node


def _file_of(node) -> str | None:
    """The file of a node, of a sequence that of the current frame; None, after a message, if it has none."""
    path = nuke.filename(node, nuke.REPLACE)
    if not path:
        nuke.message("expected a Read node with a file")
    return _literal(path)


def _literal(path) -> str | None:
    """A file name that Nuke does not evaluate; None, after a message, for others, and without a file."""
    try:
        return literal(path, _EVALUATED) if path else None
    except RuntimeError as error:
        nuke.message(str(error))
        return None


def _escaped(text: str) -> str:
    """A text of a knob that shows what was given: users type color spaces and seeds."""
    return "".join(f"\\{character}" if character in _EVALUATED else character for character in text)


def menu():
    """Add the commands to the Nodes toolbar."""
    entries = nuke.menu("Nodes").addMenu("oiiotex")
    for name, command in (
        ("Make Tile", make_tile),
        ("Pick Labels", pick_labels),
        ("Wang Plane", wang_plane),
    ):
        entries.addCommand(name, command)
