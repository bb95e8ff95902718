# SPDX-License-Identifier: Apache-2.0
"""Atomic writing of files below a folder, and reading of untrusted documents."""

from ..io.atomic import OUTSIDE, OutsideError, held_beside, release, temporary_beside, writing_only_below, written
from ..io.disk_cache import hash_of
from ..io.documents import read_document, require_plain
from ..io.schema import Allowed, Fraction, Seed, read_as, types_of
from ..quality.limit import Limit
