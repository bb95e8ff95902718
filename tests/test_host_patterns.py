# SPDX-License-Identifier: Apache-2.0
"""Images out of nothing, beside the wheel's own oiiotool."""

from __future__ import annotations

from pathlib import Path

import pytest

from .peer import same
from .sources import sources


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the sources are."""
    return sources(tmp_path_factory.mktemp("patterns"))


CHAINS = """
--create 21x13 3 -o OUT.exr
--create:type=uint8 21x13-3+4 4 -o OUT.tif
--create:type=half 21x13-3+4 5 -o OUT.exr
--pattern black 21x13 3 -o OUT.exr
--pattern constant 21x13 3 -o OUT.exr
--pattern:type=half constant:color=0.3,0.5 21x13-3+4 5 -o OUT.exr
--pattern:type=uint8 fill:top=0.1,0.2:bottom=0.9 21x13 3 -o OUT.tif
--pattern fill:left=0.1,0.2:right=0.9 21x13+3-4 3 -o OUT.exr
--pattern:type=half fill:topleft=0.1:topright=0.2,0.3:bottomleft=0.5,1,2:bottomright=1,0,0 21x13+3-4 3 -o OUT.exr
--pattern fill:color=0.2 21x13 3 -o OUT.exr
--pattern fill 21x13 3 -o OUT.exr
--pattern checker 31x23-5-3 3 -o OUT.exr
--pattern:type=uint16 checker:width=5:height=3:color1=0.1,0.2,0.3:color2=0.5 31x23 3 -o OUT.tif
--pattern noise 31x23-5-3 3 -o OUT.exr
--pattern:type=uint8 noise:type=uniform:min=0:max=0.5:seed=7 31x23 4 -o OUT.tif
--pattern:type=half noise:type=blue:seed=3 31x23+9+7 6 -o OUT.exr
--pattern noise:type=salt:value=0.7:portion=0.3:mono=1 31x23 3 -o OUT.exr
--pattern noise:type=white:mono=1 31x23 3 -o OUT.exr
--pattern noise:mean=1:stddev=0.5:mono=1 31x23 3 -o OUT.exr
--kernel gaussian 5x5 -o OUT.exr
--kernel binomial 5x3 -o OUT.exr
--kernel laplacian 3x3 -o OUT.exr
--kernel blackman-harris 3.5x7 -o OUT.exr
"""


@pytest.mark.parametrize("chain", [line for line in CHAINS.splitlines() if line])
def test_as_oiiotool(folder: Path, chain: str):
    """The same pixels, types, windows and metadata."""
    same(folder, *chain.split())
