# SPDX-License-Identifier: Apache-2.0
"""Houdini: tiles of a material's maps, and a MaterialX material that shows them. `oiiotex.shelf` has the button."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import cast

import hou
from oiiotex_line import literal, material_of, run, tile_line

_INPUTS = {  # role: input of mtlxstandard_surface, signature of mtlximage
    "color": ("base_color", "color3"),
    "roughness": ("specular_roughness", "default"),
    "metal": ("metalness", "default"),
    "emission": ("emission_color", "color3"),
    "normal": ("normal", "vector3"),
    "opacity": ("opacity", "color3"),
}
_LINEAR = "lin_rec709"
_EVALUATED = "$`"  # in a string parameter


def shelf():
    """Ask for the maps of a material, make tiles of them, and build the material."""
    chosen = hou.ui.selectFile(
        title="Maps of a material (color, normal, roughness, ...)",
        file_type=hou.fileType.Image,
        multiple_select=True,
    )
    names = [name.strip() for name in chosen.split(";") if name.strip()]
    if not names:
        return None
    try:
        # $HIP is expanded; an expression in backticks would be run
        files = [literal(hou.text.expandString(literal(name, "`")), _EVALUATED) for name in names]
        maps, name = material_of(files)
        with hou.InterruptableOperation("oiiotex: making tiles", open_interrupt_dialog=True):
            words, tiles = tile_line(maps, Path(files[0]).parent / f"{name}_tile")
            run(words)
    except RuntimeError as error:
        hou.ui.displayMessage(str(error), severity=hou.severityType.Error)
        return None
    return material(tiles, name, comment=shlex.join(words))


def material(files, name, parent="/mat", relief=0.05, comment=""):
    """A MaterialX subnet of `mtlximage` nodes and a standard surface.

    Parameters
    ----------
    files : dict of str to path
        Maps by role.
    name : str
    parent : str
        A material network: /mat, or a Material Library node.
    relief : float
        Distance between heights 0 and 1.
    comment : str
        Comment of the subnet: the line that made the files.

    Returns
    -------
    hou.Node
    """
    for path in files.values():
        literal(path, _EVALUATED)
    network = hou.node(parent)
    if network is None:
        raise RuntimeError(f"{parent}: expected a material network, such as /mat")
    subnet = _created(network, "subnet", hou.text.variableName(name))
    subnet.deleteItems(subnet.allItems())
    subnet.setGenericFlag(hou.nodeFlag.Material, True)
    subnet.setComment(comment)
    surface = _created(subnet, "mtlxstandard_surface", "surface")
    _output(subnet, surface, "surface")
    for role, path in files.items():
        wanted, signature = _INPUTS.get(role, ("", "default"))
        image = _created(subnet, "mtlximage", role)
        space = _LINEAR if role in ("color", "emission") else "Raw"
        image.setParms({"signature": signature, "file": str(path), "filecolorspace": space})
        if role == "normal":
            turned = _created(subnet, "mtlxnormalmap", "normalmap")
            turned.setNamedInput("in", image, "out")
            surface.setNamedInput(wanted, turned, "out")
        elif role == "height":
            moved = _created(subnet, "mtlxdisplacement", "displacement")
            moved.setNamedInput("displacement", image, "out")
            moved.setParms({"scale": relief})
            _output(subnet, moved, "displacement")
        elif wanted:
            surface.setNamedInput(wanted, image, "out")
    if "emission" in files:
        surface.setParms({"emission": 1})
    subnet.layoutChildren()
    return subnet


def _created(network, kind: str, name: str) -> hou.OpNode:
    """A new node; type checkers know its methods."""
    return cast("hou.OpNode", network.createNode(kind, name))


def _output(subnet, node, kind):
    """Connect a node to an output of the subnet."""
    output = _created(subnet, "subnetconnector", f"{kind}_output")
    output.setParms({"connectorkind": "output", "parmname": kind, "parmlabel": kind, "parmtype": kind})
    output.setInput(0, node)
