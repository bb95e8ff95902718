# SPDX-License-Identifier: Apache-2.0
"""Atomic writing of files below a folder, and reading of untrusted documents."""

from ..io.atomic import OUTSIDE, OutsideError, held_beside, release, temporary_beside, writing_only_below, written
from ..io.disk_cache import hash_of
from ..io.documents import read_document, require_plain
from ..io.schema import Allowed, Fraction, Seed, read_as, types_of
from ..quality.limit import Limit

__all__ = [
    "OUTSIDE",
    "Allowed",
    "Fraction",
    "Limit",
    "OutsideError",
    "Seed",
    "hash_of",
    "held_beside",
    "read_as",
    "read_document",
    "release",
    "require_plain",
    "temporary_beside",
    "types_of",
    "writing_only_below",
    "written",
]
