# SPDX-License-Identifier: Apache-2.0
"""Maya and Arnold: tiles of a material's maps as .tx, and an aiStandardSurface that shows them.

In the script editor: `import oiiotex_maya; oiiotex_maya.make_material()`.
"""

from __future__ import annotations

import shlex
from pathlib import Path

from maya import cmds
from oiiotex_line import material_of, run, tile_line

_LINEAR = "scene-linear Rec.709-sRGB"
_INPUTS = {  # role: output of aiImage, input of aiStandardSurface
    "color": ("outColor", "baseColor"),
    "emission": ("outColor", "emissionColor"),
    "opacity": ("outColor", "opacity"),
    "roughness": ("outColorR", "specularRoughness"),
    "metal": ("outColorR", "metalness"),
}


def make_material(**modifiers):
    """Ask for the maps of a material, make tiles of them, and build the material.

    Parameters
    ----------
    **modifiers
        Of --texstationarize, such as `seed=3, preset="even"`.

    Returns
    -------
    str
        The shading group, or None if nothing was chosen or made.
    """
    files = list(cmds.fileDialog2(fileMode=4, caption="Maps of a material (color, normal, roughness, ...)") or [])
    if not files:
        return None
    try:
        maps, name = material_of(files)
        words, tiles = tile_line(maps, Path(files[0]).parent / f"{name}_tile", kind="tx", **modifiers)
        run(words)
    except RuntimeError as error:
        cmds.warning(str(error))
        return None
    group = material(tiles, name)
    cmds.addAttr(group, longName="oiiotex", dataType="string")
    cmds.setAttr(f"{group}.oiiotex", shlex.join(words), type="string")
    return group


def material(files, name, relief=0.05):
    """An aiStandardSurface with an aiImage for each map.

    Parameters
    ----------
    files : dict of str to path
        Maps by role, as .tx.
    name : str
    relief : float
        Distance between heights 0 and 1, in scene units.

    Returns
    -------
    str
        The shading group.
    """
    surface = cmds.shadingNode("aiStandardSurface", asShader=True, name=f"{name}_surface")
    group = cmds.sets(renderable=True, noSurfaceShader=True, empty=True, name=f"{name}_SG")
    cmds.connectAttr(f"{surface}.outColor", f"{group}.surfaceShader")
    for role, path in files.items():
        image = cmds.shadingNode("aiImage", asTexture=True, isColorManaged=True, name=f"{name}_{role}")
        cmds.setAttr(f"{image}.ignoreColorSpaceFileRules", True)
        cmds.setAttr(f"{image}.colorSpace", _LINEAR if role in ("color", "emission") else "Raw", type="string")
        cmds.setAttr(f"{image}.autoTx", False)
        cmds.setAttr(f"{image}.filename", str(path), type="string")
        if role == "normal":
            turned = cmds.shadingNode("aiNormalMap", asUtility=True, name=f"{name}_normalmap")
            cmds.connectAttr(f"{image}.outColor", f"{turned}.input")
            cmds.connectAttr(f"{turned}.outValue", f"{surface}.normalCamera")
        elif role == "height":
            moved = cmds.shadingNode("displacementShader", asShader=True, name=f"{name}_displacement")
            cmds.connectAttr(f"{image}.outColorR", f"{moved}.displacement")
            cmds.setAttr(f"{moved}.scale", relief)
            cmds.connectAttr(f"{moved}.displacement", f"{group}.displacementShader")
        elif role in _INPUTS:
            output, wanted = _INPUTS[role]
            cmds.connectAttr(f"{image}.{output}", f"{surface}.{wanted}")
    if "emission" in files:
        cmds.setAttr(f"{surface}.emission", 1)
    return group
