# SPDX-License-Identifier: Apache-2.0
"""Arrays that are kept on disk from one run to the next, by the hash of all that they follow from."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import numpy as np

from ..errors import Error
from ..temporary import temporary_beside


def kept(path: Path, fits: Callable[[np.ndarray], bool], make: Callable[[], np.ndarray]) -> np.ndarray:
    """The array in the file; made and put there where it is missing, spoiled or does not fit.

    What an interrupted run left half-written is swept. A run does not fail for want of a cache.
    """
    try:
        found = np.load(path, allow_pickle=False)
        if fits(found):
            return found
    except (OSError, ValueError, EOFError):  # absent, or spoiled
        pass
    made = make()
    try:
        os.makedirs(path.parent, exist_ok=True)
        with temporary_beside(path) as temporary, open(temporary, "wb") as file:
            np.save(file, made)
    except (OSError, Error):
        pass
    return made
