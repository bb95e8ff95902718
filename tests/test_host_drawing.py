# SPDX-License-Identifier: Apache-2.0
"""Drawing, beside the wheel's own oiiotool."""

from __future__ import annotations

from pathlib import Path

import pytest

from .peer import same
from .sources import sources


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the sources are."""
    return sources(tmp_path_factory.mktemp("drawing"))


CHAINS = """
plain.tif --box:color=1,0,0 3,4,20,15 -o OUT.tif
plain.tif --box:color=0.5:fill=1 -3,4,20,50 -o OUT.tif
plain.tif --box:color=1,0,0,0.25:fill=1 3,4,20,15 -o OUT.tif
over.exr --box:color=0.1,0.2,0.3,0.5:fill=1 -4,4,20,15 -o OUT.exr
over.exr --box:color=0.1,0.2,0.3,0.5 20,15,-4,4 -o OUT.exr
inset.exr --box 7,12,7,12 -o OUT.exr
plain.tif --line:color=1,0.5,0.25 1,2,30,17,5,20,1,2 -o OUT.tif
over.exr --line:color=0.5,0.25,0.1,0.5 -9,-2,30,17,5,60 -o OUT.exr
plain.tif --line:color=0.3 -9,-2,30,17,5,60 -o OUT.tif
inset.exr --point:color=1,0.5 4,10,7,11,100,100 -o OUT.exr
over.exr --point:color=1,0.5,0.2,0.4 -4,1,7,11 -o OUT.exr
plain.tif --text Hello -o OUT.tif
plain.tif --text:x=3:y=15:size=12:color=1,0,0 Hiya -o OUT.tif
plain.tif --text:x=3:y=15:size=12:color=1,0,0,0.5:shadow=2 Hiya -o OUT.tif
over.exr --text:xalign=center:yalign=center:size=20:color=0.5,0.2,0.1,0.6:shadow=1:font=DroidSerif Agq -o OUT.exr
over.exr --text:xalign=right:yalign=top:size=14 Agq -o OUT.exr
five.exr --text:xalign=r:yalign=b:size=14:color=0.3 Agq -o OUT.exr
plain.tif --text:x=300 Hello -o OUT.tif
parts.exr --box:allsubimages=1:color=0.5 3,3,9,9 -d float -o OUT.exr
parts.exr --box:color=0.5 3,3,9,9 -o OUT.exr
plain.tif --fill:color=0.5,0.2 10x7+3+4 -o OUT.tif
plain.tif --fill:top=1,0,0:bottom=0,0,1 10x70+3+4 -o OUT.tif
over.exr --fill:left=1,0,0:right=0,0,1,0 17x9-9+4 -o OUT.exr
inset.exr --fill:topleft=0.1:topright=0.2,0.3:bottomleft=0.5,1,2:bottomright=1,0,0 50% -o OUT.exr
alpha.exr --fill 5x5+1+1 -o OUT.exr
parts.exr --fill:color=0.5 5x5+1+1 -d float -o OUT.exr
parts.exr --fill:color=0.5:allsubimages=1 5x5+1+1 -d float -o OUT.exr
five.exr --box:color=0.5:fill=1 2,3,9,9 -o OUT.exr
four.exr --text:x=3:y=15:size=14:color=0.3,0.4,0.5,0.6,0.7 Agq -o OUT.exr
tiled.tif --box:color=0.5:fill=1 2,3,9,9 -o OUT.tif
tiled.tif --flip -o OUT.tif
tiled.tif --fit 20x20 -o OUT.tif
"""


@pytest.mark.parametrize("chain", [line for line in CHAINS.splitlines() if line])
def test_as_oiiotool(folder: Path, chain: str):
    """The same pixels, types, windows and metadata."""
    same(folder, *chain.split())
