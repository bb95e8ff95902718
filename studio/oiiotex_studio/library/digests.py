# SPDX-License-Identifier: Apache-2.0
"""Hashes of files; unchanged photos are not read again."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from oiiotex.engine.errors import Error, one_line, reason_of

from ..api.files import digest_of, owned
from ..recipes.found import Material
from .catalog import Catalog

_READERS = 4  # threads that hash files


def digests_of(photos: Path, found: Sequence[Material], catalog: Catalog) -> tuple[dict[str, str], dict[str, str]]:
    """The SHA-256 of every file in use, and errors of files that cannot be read. Unchanged files are not read again."""
    known, digests, unread, new = catalog.sources(), dict[str, str](), dict[str, str](), []
    for path in sorted({file.path for material in found for file in material.maps.values()}):
        if not is_text(path):
            unread[path] = f"{one_line(path)}: the file name is not UTF-8; rename it"
            continue
        try:
            status = os.stat(photos / path)
        except OSError as error:
            unread[path] = _why(path, error)
            continue
        facts = status.st_size, status.st_mtime_ns
        size, changed, digest = known.get(str(photos / path), (None, None, ""))
        if facts == (size, changed):
            digests[path] = digest
        else:
            new.append((path, *facts))

    def digest_or_error(row: tuple[str, int, int]) -> str | OSError:
        try:
            return digest_of(photos / row[0])
        except OSError as error:
            return error

    with ThreadPoolExecutor(_READERS) as readers:
        made = list(zip(new, readers.map(digest_or_error, new), strict=True))
    unread |= {row[0]: _why(row[0], digest) for row, digest in made if isinstance(digest, OSError)}
    read = [(row, digest) for row, digest in made if isinstance(digest, str)]
    if read:
        catalog.remember_sources((str(photos / path), size, changed, digest) for (path, size, changed), digest in read)
    return digests | {row[0]: digest for row, digest in read}, unread


def _why(path: str, error: OSError) -> str:
    return f"{path}: cannot read: {error.strerror or reason_of(error)}"


def is_text(path: str | Path) -> bool:
    """Whether a name is valid UTF-8, which SQLite and JSON require."""
    try:
        str(path).encode()
    except UnicodeEncodeError:
        return False
    return True


def faults(folder: Path, files: Sequence[Mapping[str, Any]]) -> list[str]:
    """Errors of the files of a folder, compared with their recorded sizes and hashes."""
    wrong = []
    for file in files:
        path = folder / file["path"]
        try:
            if not owned(path, folder).is_file():
                wrong.append(f"{path} is missing")
            elif path.stat().st_size != file["bytes"] or digest_of(path) != file["sha256"]:
                wrong.append(f"{path} has changed since it was written")
        except (Error, OSError) as error:
            wrong.append(reason_of(error))
    return wrong
