# SPDX-License-Identifier: Apache-2.0
"""Filters, beside the wheel's own oiiotool."""

from __future__ import annotations

from pathlib import Path

import pytest

from .peer import same
from .sources import sources


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the sources are."""
    return sources(tmp_path_factory.mktemp("filtering"))


CHAINS = """
plain.tif --blur 5x5 -o OUT.tif
over.exr --blur 5x3 -o OUT.exr
inset.exr --blur:kernel=box 4x7 -o OUT.exr
alpha.exr --blur:kernel=binomial 5x3 -o OUT.exr
alpha.exr --blur:kernel=lanczos3 3.5x1 -o OUT.exr
parts.exr --blur:allsubimages=1:kernel=triangle 3x3 -d float -o OUT.exr
over.exr --kernel gaussian 7x3 --convolve -o OUT.exr
plain.tif --kernel laplacian 3x3 --convolve -d float -o OUT.tif
plain.tif dark.exr --crop 5x5+5+4 --convolve -d float -o OUT.exr
over.exr --median 3x3 -o OUT.exr
inset.exr --median 5x2 -o OUT.exr
plain.tif --median 4x0 -o OUT.tif
plain.tif --median 1x1 -o OUT.tif
over.exr --dilate 3x3 -o OUT.exr
inset.exr --dilate 5x2 -o OUT.exr
plain.tif --erode 3x4 -o OUT.tif
over.exr --erode 1x7 -o OUT.exr
parts.exr -a --erode 3x3 -d float -o OUT.exr
plain.tif --unsharp -o OUT.tif
over.exr --unsharp:width=5:contrast=1.5 -o OUT.exr
inset.exr --unsharp:kernel=median:width=4:threshold=0.2 -o OUT.exr
alpha.exr --unsharp:kernel=box:width=2.5:threshold=0.3:contrast=-1 -o OUT.exr
over.exr --laplacian -o OUT.exr
inset.exr --laplacian -o OUT.exr
gray.tif --laplacian -d float -o OUT.exr
alpha.exr --fillholes -o OUT.exr
over.exr --fillholes -o OUT.exr
parts.exr --subimage 1 --fillholes -d float -o OUT.exr
plain.tif --fft -d float -o OUT.exr
inset.exr --fft -d float -o OUT.exr
over.exr --fft -d float -o OUT.exr
gray.tif --fft --ifft -d float -o OUT.exr
alpha.exr --decorrstretch -o OUT.exr
plain.tif --decorrstretch:firstchannel=1:nchannels=2:scale=1.5:sigma=0.2:mean=0.5 -d float -o OUT.exr
over.exr --decorrstretch:percentile=5:mode=correlation -o OUT.exr
gray.tif --demosaic -d float -o OUT.exr
gray.tif --demosaic:algorithm=linear:layout=GRBG -d float -o OUT.exr
gray.tif --demosaic:pattern=xtrans -d float -o OUT.exr
gray.tif --crop 15x23+3+4 --demosaic:layout=BGGR:white_balance_mode=manual:white_balance=2,1,1.5,1.2 -d float -o OUT.exr
gray.tif --demosaic:white_balance_mode=manual:white_balance=2,1,1.5 -d float -o OUT.exr
"""


@pytest.mark.parametrize("chain", [line for line in CHAINS.splitlines() if line])
def test_as_oiiotool(folder: Path, chain: str):
    """The same pixels, types, windows and metadata."""
    same(folder, *chain.split())
