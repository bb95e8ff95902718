# SPDX-License-Identifier: Apache-2.0
"""Atomic writing of files below a folder, folders that a run owns, and reading of untrusted documents."""

from oiiotex.engine.io.atomic import (
    OUTSIDE,
    OutsideError,
    held_beside,
    release,
    sweep,
    temporary_beside,
    writing_only_below,
    written,
)
from oiiotex.engine.io.disk_cache import hash_of
from oiiotex.engine.io.documents import read_document, require_plain
from oiiotex.engine.io.owned import checked_name, copy_folder, owned, remove_folder
from oiiotex.engine.io.schema import Allowed, Fraction, Seed, read_as, types_of
from oiiotex.engine.io.sealed import digest_of
from oiiotex.synthesis.quality.limit import Limit
