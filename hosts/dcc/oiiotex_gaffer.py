# SPDX-License-Identifier: Apache-2.0
"""Gaffer: a box that makes a tile for each seed on the farm, and shows one.

In Gaffer's Python editor: `import oiiotex_gaffer; root["tiles"] = oiiotex_gaffer.tiles("photo.png", "tile")`.
"""

from __future__ import annotations

import shlex

import Gaffer
import GafferDispatch
import GafferImage
from oiiotex_line import tile_line

_SEED = "${oiiotex:seed}"


def tiles(photo, out, seeds=4, **given):
    """A box with a SystemCommand that makes a tile, a Wedge over seeds, and an ImageReader of the result.

    Dispatch the box's `task` to make `OUT.SEED_color.exr` of all seeds. Its plug `seed` chooses the tile of `out`.

    Parameters
    ----------
    photo, out : path
    seeds : int
        Number of tiles.
    **given
        Of `tile_line`: `kind`, `space`, and modifiers of --texstationarize.

    Returns
    -------
    Gaffer.Box
    """
    words, files = tile_line({"color": photo}, f"{out}.{_SEED}", seed=_SEED, **given)
    box = Gaffer.Box("tiles")
    box["seed"] = Gaffer.IntPlug(defaultValue=0, flags=Gaffer.Plug.Flags.Default | Gaffer.Plug.Flags.Dynamic)
    box["command"] = GafferDispatch.SystemCommand()
    # Gaffer replaces the seed before a shell sees the command, so quotes around it do no harm
    box["command"]["command"].setValue(shlex.join(words))
    box["wedge"] = GafferDispatch.Wedge()
    box["wedge"]["variable"].setValue("oiiotex:seed")
    box["wedge"]["mode"].setValue(int(GafferDispatch.Wedge.Mode.IntRange))
    box["wedge"]["intMin"].setValue(0)
    box["wedge"]["intMax"].setValue(seeds - 1)
    box["wedge"]["preTasks"][0].setInput(box["command"]["task"])
    box["reader"] = GafferImage.ImageReader()
    box["reader"]["fileName"].setValue(files["color"])
    box["chosen"] = Gaffer.ContextVariables()
    box["chosen"].setup(box["reader"]["out"])
    box["chosen"]["in"].setInput(box["reader"]["out"])
    box["chosen"]["variables"].addChild(Gaffer.NameValuePlug("oiiotex:seed", 0, "seed"))
    box["chosen"]["variables"]["seed"]["value"].setInput(box["seed"])
    Gaffer.PlugAlgo.promoteWithName(box["wedge"]["task"], "task")
    Gaffer.PlugAlgo.promoteWithName(box["chosen"]["out"], "out")
    return box
