# SPDX-License-Identifier: Apache-2.0
"""Broken recipes, meshes, catalogs, archives, configs, caches: read or refused in one line, in bounded memory."""

from __future__ import annotations

import pytest

from tests import fuzz_documents
from tests.fuzz_documents import KINDS

NAMES = [kind.name for kind in KINDS]


@pytest.mark.parametrize("kind", KINDS, ids=NAMES)
def test_a_broken_document_is_read_or_refused(tmp_path, kind):
    whole = kind.whole(tmp_path)
    for number in range(40):
        fuzz_documents.read(kind, number, tmp_path / "case", whole)
