# SPDX-License-Identifier: Apache-2.0
"""Runs the program `oiiotex` from the Python of Nuke, Houdini or Maya.

It needs neither oiiotex nor numpy in that Python. `$OIIOTEX` names the program; default: `oiiotex` in `$PATH`.
"""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

KINDS = {"color": "color", "emission": "color", "normal": "normal", "height": "height"}  # others are data
_OURS = ("PYTHONPATH", "PYTHONHOME", "LD_LIBRARY_PATH", "LD_PRELOAD")  # of the program that runs this
_TX = "-otex:wrap=periodic"
_LINEAR = "lin_rec709_scene"


def literal(path, evaluated):
    """A file name, unless it has a character that the program that runs this would evaluate.

    Raises
    ------
    RuntimeError
        With the character. A backslash before it is not the same in all places of these programs.
    """
    one = next((character for character in str(path) if character in evaluated), None)
    if one is not None:
        raise RuntimeError(f"{path}: {one} in a file name would be evaluated here; rename the file or its folder")
    return str(path)


def role_of(path):
    """The role of a map from the end of its name, such as `wall_roughness.png`; None if there is none."""
    words = Path(path).stem.lower().replace("-", "_").replace(".", "_").split("_")
    known = {"albedo": "color", "basecolor": "color", "diffuse": "color", "rough": "roughness", "metalness": "metal"}
    known |= {"metallic": "metal", "displacement": "height", "bump": "height", "nrm": "normal"}
    roles = ("color", "normal", "roughness", "metal", "height", "opacity", "emission")
    role = known.get(words[-1], words[-1])
    return role if role in roles else None


def material_of(files):
    """The maps of a material by role, and its name, from file names such as `wall_color.png`; one file is a photo.

    Raises
    ------
    RuntimeError
        The names do not end with different roles.
    """
    first = Path(files[0])
    if len(files) == 1:
        return {"color": files[0]}, first.stem
    maps = {role_of(path): path for path in files}
    if None in maps or len(maps) < len(files):
        example = "such as wall_color.png, wall_normal.png"
        raise RuntimeError(f"expected file names that end with different roles, {example}")
    return maps, first.stem.rpartition("_")[0]


def tile_line(maps, out, kind="exr", space=None, **modifiers):
    """The line that makes tiles of the maps of a material, and the files it writes: color maps in linear Rec.709.

    Parameters
    ----------
    maps : dict of str to path
        Files by role: color, normal, roughness, metal, height, opacity, emission. A photo is `{"color": path}`.
    out : path
        The file names without `_ROLE.exr`.
    kind : {"exr", "tx"}
        Half-float EXR, or MIP-mapped textures for a renderer.
    space : str, optional
        Color space of the color maps. Default: the one that the files name.
    **modifiers
        Of --texstationarize, such as `seed=3, preset="even"`.

    Returns
    -------
    (list of str, dict of str to str)
        Words of the line, and files by role.
    """
    roles = sorted(maps, key=lambda role: KINDS.get(role) != "color")  # the first map decides
    words = [os.environ.get("OIIOTEX", "oiiotex")]
    for role in roles:
        words.append(str(maps[role]))
        words += ["--iscolorspace", space] if space and KINDS.get(role) == "color" else []
    given = {}
    if len(roles) > 1:
        given = {"kinds": ",".join(KINDS.get(role, "data") for role in roles)}
    elif KINDS.get(roles[0]) != "color":
        given = {"data": 1}
    given.update(modifiers)
    words.append("--texstationarize" + "".join(f":{name}={_quoted(value)}" for name, value in given.items()))
    files = {role: f"{out}_{role}.{kind}" for role in roles}
    for number, role in enumerate(reversed(roles)):  # the last map is on the top of the stack
        words += ["--pop"] if number else []
        words += ["--tocolorspace", _LINEAR] if KINDS.get(role) == "color" else []
        words += ["-d", "half", _TX if kind == "tx" else "-o", files[role]]
    return words, files


def _quoted(value):
    """A modifier's value; a colon in it, as in C:/shots, would begin another modifier."""
    return f'"{value}"' if ":" in str(value) else value


def run(words):
    """Run a line, without the Python and library paths of the program that runs this.

    Raises
    ------
    RuntimeError
        With the error message of the line.
    """
    environment = {name: value for name, value in os.environ.items() if name not in _OURS}
    try:
        done = subprocess.run(words, env=environment, stdin=subprocess.DEVNULL, capture_output=True, text=True)
    except OSError as error:
        text = f"{words[0]} cannot be started ({error.strerror}); set OIIOTEX to the path of oiiotex"
        raise RuntimeError(text) from error
    if done.returncode:
        raise RuntimeError((done.stderr.strip().splitlines() or [f"{words[0]}: exit code {done.returncode}"])[-1])
