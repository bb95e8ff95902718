# SPDX-License-Identifier: Apache-2.0
"""Other tools that make a photo tile, or synthesize texture from it: installation, calls and timing.

Each is a separate program, started with a photo and the PNG to write, and timed from start to exit, including loading
and saving. None is imported here or required by oiiotex. Python packages run under the interpreter $PEERS_PYTHON, by
default the current one::

    apt-get install --no-install-recommends gmic gegl
    python3 -m venv /tmp/peers
    /tmp/peers/bin/pip install resynthesizer PyPatchMatch img2texture numpy pillow
    PEERS_PYTHON=/tmp/peers/bin/python python -m benchmarks.tilebench.compare

`pip install gmic` is used for G'MIC if there is no `gmic` program. gimp-texturize is a
plug-in of GIMP 2.10 (`apt-get install gimp-texturize`), run by `gimp-console`; Embark's texture-synthesis comes by
`cargo install texture-synthesis-cli`.

`SYNTHESIZERS` make an image of the requested size, which does not tile. The others keep the size of the photo, except
img2texture, which loses the fifth of each side that it blends.
"""

from __future__ import annotations

import functools
import os
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from shutil import which

Size = tuple[int, int]

_GMIC_INSTALL = "apt-get install gmic (or pip install gmic)"

# G'MIC from PyPI takes one string. A path with a space is quoted; arguments of commands must not be.
_GMIC_MODULE = """
import sys, gmic
gmic.run(" ".join(f'"{argument}"' if " " in argument else argument for argument in sys.argv[1:]))
"""

# Shifts the photo by half its size, so that its edges meet in the middle, and masks the cross where they do.
_CROSS = """
import sys
import numpy as np
from PIL import Image

photo, out = sys.argv[1:]
image = np.asarray(Image.open(photo).convert("RGB"))
h, w = image.shape[:2]
r = min(h, w) // 16
image = np.roll(image, (h // 2, w // 2), (0, 1))
hole = np.zeros((h, w), np.uint8)
hole[h // 2 - r : h // 2 + r] = 255
hole[:, w // 2 - r : w // 2 + r] = 255
"""

# Resynthesizer's default parameters match across the borders, so the ends of the cross meet as well.
_RESYNTHESIZER = """
from resynthesizer import resynthesize

image = np.asarray(resynthesize(Image.fromarray(image), Image.fromarray(hole)))
Image.fromarray(np.roll(image, (-(h // 2), -(w // 2)), (0, 1))).save(out)
"""

# PyPatchMatch does not match across the borders: the two places where the ends of the cross meet are brought inside
# by a further shift and filled once more.
_PYPATCHMATCH = """
from patchmatch import inpaint

image = np.roll(inpaint(image, hole, patch_size=3), (h // 4, w // 4), (0, 1))
hole[:] = 0
for y, x in ((h // 2 + h // 4, w // 4), (h // 4, w // 2 + w // 4)):
    hole[y - r : y + r, x - r : x + r] = 255
image = inpaint(image, hole, patch_size=3)
Image.fromarray(np.roll(image, (-(h // 2) - h // 4, -(w // 2) - w // 4), (0, 1))).save(out)
"""

# The photo is next to the area to fill, and there is also an area to fill below the photo: the image is a
# rectangle. What is under the photo is thrown away.
_RESYNTHESIZE = """
import sys
import numpy as np
from PIL import Image
from resynthesizer import getDefaultParams, resynthesize

photo, out, width, height = *sys.argv[1:3], *map(int, sys.argv[3:])
image = np.asarray(Image.open(photo).convert("RGB"))
h, w = image.shape[:2]
canvas = np.zeros((max(h, height), w + width, 3), np.uint8)
hole = np.full(canvas.shape[:2], 255, np.uint8)
canvas[:h, :w], hole[:h, :w] = image, 0
how = getDefaultParams()
how.isMakeSeamlesslyTileableHorizontally = how.isMakeSeamlesslyTileableVertically = how.matchContextType = 0
Image.fromarray(np.asarray(resynthesize(Image.fromarray(canvas), Image.fromarray(hole), how))[:height, w:]).save(out)
"""

# overlap of 100 px; not tileable
_TEXTURIZE = """
(let* ((photo (car (gimp-file-load RUN-NONINTERACTIVE "{photo}" "{photo}")))
       (layer (car (gimp-image-get-active-layer photo))))
  (gimp-plugin-texturize RUN-NONINTERACTIVE photo layer {width} {height} 100 0)
  (let* ((made (aref (cadr (gimp-image-list)) 0))
         (layer (car (gimp-image-get-active-layer made))))
    (file-png-save RUN-NONINTERACTIVE made layer "{out}" "{out}" 0 6 0 0 0 0 0))
  (gimp-quit 0))
"""


class ToolError(Exception):
    """A tool failed, wrote nothing or took too long."""


@dataclass(frozen=True)
class Tool:
    """A program that makes a texture from a photo.

    Attributes
    ----------
    name : str
        Its name in tables.
    install : str
        What installs it.
    available : callable
        Whether it is installed.
    command : callable
        The command line for a photo, the PNG to write and the (width, height) wanted.
    """

    name: str
    install: str
    available: Callable[[], bool]
    command: Callable[[Path, Path, Size], list[str]]

    def run(self, photo: Path, out: Path, size: Size, timeout: float = 600.0) -> float:
        """Seconds from start to exit of the tool.

        Parameters
        ----------
        photo, out : Path
            Image to read, PNG to write; `out` is replaced if it exists.
        size : (int, int)
            Width and height wanted; most tools go by the photo.
        timeout : float
            Seconds after which the tool is stopped.

        Raises
        ------
        ToolError
            The tool fails, writes nothing or takes too long; the text has the end of what it said.
        """
        out.unlink(missing_ok=True)
        command = self.command(photo.resolve(), out.resolve(), size)
        start = time.perf_counter()
        try:
            done = subprocess.run(
                command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, timeout=timeout
            )
        except subprocess.TimeoutExpired:
            raise ToolError(f"took more than {timeout:g} s") from None
        seconds = time.perf_counter() - start
        if done.returncode != 0 or not out.is_file():
            said = done.stdout.decode(errors="replace").strip()
            raise ToolError(f"exit status {done.returncode}, {said[-1000:] or 'no message'}")
        return seconds


def interpreter() -> str:
    """The Python that has the tools that are Python packages: $PEERS_PYTHON, else the one that runs this."""
    named = os.environ.get("PEERS_PYTHON")
    if named and which(named) is None:
        sys.exit(f"PEERS_PYTHON={named}: no such program")
    return named or sys.executable


@functools.cache
def _has_modules(*names: str) -> bool:
    """Whether the tools' Python finds all of these top-level modules."""
    check = "import sys; from importlib.util import find_spec; sys.exit(None in map(find_spec, sys.argv[1:]))"
    return subprocess.run([interpreter(), "-c", check, *names]).returncode == 0


def _gmic(name: str, filter_for: Callable[[Size], list[str]]) -> Tool:
    """G'MIC commands as a tool: `filter_for` gives those between reading and writing for a (width, height)."""

    def command(photo: Path, out: Path, size: Size) -> list[str]:
        start = ["gmic"] if which("gmic") else [interpreter(), "-c", _GMIC_MODULE]
        return [*start, str(photo), "to_rgb", *filter_for(size), "cut", "0,255", "output", str(out)]

    return Tool(name, _GMIC_INSTALL, lambda: which("gmic") is not None or _has_modules("gmic"), command)


def _inpainting(package: str, module: str, fill: str) -> Tool:
    """A Python inpainting package as a tool: `fill` follows `_CROSS`, fills the hole, shifts back and saves."""
    return Tool(
        package.lower(),
        f"pip install {package} numpy pillow",
        lambda: _has_modules(module, "numpy", "PIL"),
        lambda photo, out, size: [interpreter(), "-c", _CROSS + fill, str(photo), str(out)],
    )


PEERS: tuple[Tool, ...] = (
    _gmic("gmic-matchpatch", lambda size: ["syntexturize_matchpatch", f"{size[0]},{size[1]}"]),
    # a frame inside the image, with the default patch size (7) and blend size (5)
    _gmic("gmic-frame-seamless", lambda size: ["frame_seamless", "{round(min(w,h)/16)},7,5,0"]),
    _gmic("gmic-periodize-poisson", lambda size: ["periodize_poisson"]),
    _inpainting("resynthesizer", "resynthesizer", _RESYNTHESIZER),
    _inpainting("PyPatchMatch", "patchmatch", _PYPATCHMATCH),
    Tool(
        "gegl-tile-seamless",
        "apt-get install gegl",
        lambda: which("gegl") is not None,
        lambda photo, out, size: ["gegl", str(photo), "-o", str(out), "--", "gegl:tile-seamless"],
    ),
    Tool(
        "img2texture",
        "pip install img2texture",
        lambda: _has_modules("img2texture"),
        lambda photo, out, size: [interpreter(), "-m", "img2texture", str(photo), str(out)],
    ),
)

SYNTHESIZERS: tuple[Tool, ...] = (
    PEERS[0],
    Tool(
        "resynthesizer",
        "pip install resynthesizer numpy pillow",
        lambda: _has_modules("resynthesizer", "numpy", "PIL"),
        lambda photo, out, size: [interpreter(), "-c", _RESYNTHESIZE, str(photo), str(out), *map(str, size)],
    ),
    Tool(
        "gimp-texturize",
        "apt-get install gimp-texturize",
        lambda: which("gimp-console") is not None,
        lambda photo, out, size: [
            *("gimp-console", "-i", "-d", "-f", "-b"),
            _TEXTURIZE.format(photo=photo, out=out, width=size[0], height=size[1]).replace("\n", " "),
        ],
    ),
    Tool(
        "embark",
        "cargo install texture-synthesis-cli",
        lambda: which("texture-synthesis") is not None,
        lambda photo, out, size: [
            *("texture-synthesis", "--out-size", f"{size[0]}x{size[1]}", "-o", str(out), "generate", str(photo))
        ],
    ),
)

CROPS = {  # 256 x 256 px of photos from there on; the last is ugly: its stones are nearly as large as the crop
    "clover_lawn": (384, 384), "castle_brick_broken": (384, 300), "roof_slates": (300, 400),
    "pebbles_beach_shadow": (200, 150),
}  # fmt: skip
