# SPDX-License-Identifier: Apache-2.0
"""Export: copies assets to a folder, with an index and Blender's list of catalogs."""

from __future__ import annotations

import contextlib
import json
import os
import unicodedata
from collections.abc import Callable, Sequence
from pathlib import Path

from oiiotex.engine.errors import Error, ParameterError, one_line, reason_of

from ..api.files import copy_folder, owned, read_document, remove_folder, temporary_beside
from ..materials.blender_catalogs import BLENDER, blender_catalog
from .asset import SCHEMA, read_sidecar
from .catalog import SIDECAR, Asset, Catalog

INDEX, EXPORT_SCHEMA = "index.json", "oiiotex.export/1"


def export(catalog: Catalog, target: Path, chosen: Sequence[Asset], done: Callable[[str], object]) -> int:
    """Copy assets to a folder, each in a subfolder with its name, with an index and Blender's list of catalogs.

    Returns the number of copied assets; the others were up to date.
    """
    count, index = 0, []
    if target.resolve().is_relative_to(catalog.library.resolve()):
        raise ParameterError(f"{target} is inside the library: expected a folder outside of it")
    _require_distinct([asset.name for asset in chosen])
    for asset in chosen:
        _require_replaceable(owned(target / asset.name, target))
    if os.path.lexists(target / INDEX) and not _is_of(EXPORT_SCHEMA, target / INDEX):
        raise _foreign(target / INDEX, "an export index")
    blender = _blender_text(catalog, target)
    try:
        target.mkdir(parents=True, exist_ok=True)
        for asset in chosen:
            source, final = catalog.library / asset.folder, target / asset.name
            index.append(asset.name)
            if _same(final, asset):
                continue
            aside = target / f".{asset.name}-{os.urandom(6).hex()}"
            copy_folder(source, catalog.library, aside)
            if final.is_dir():
                old = target / f".{asset.name}-{os.urandom(6).hex()}"
                final.rename(old)
                aside.rename(final)
                remove_folder(old, target)
            else:
                aside.rename(final)
            count += 1
            done(asset.name)
    except OSError as error:
        raise Error(f"{target}: {error.strerror or reason_of(error)}") from error
    _write(target / BLENDER, blender)
    _write(target / INDEX, json.dumps({"schema": EXPORT_SCHEMA, "assets": index}, indent=1) + "\n")
    return count


def write_blender(catalog: Catalog, folder: Path) -> None:
    """Write Blender's list of catalogs, with one per first tag and one for untagged assets; other entries are kept."""
    _write(folder / BLENDER, _blender_text(catalog, folder))


def blender_list(folder: Path) -> str:
    """The content of Blender's list of catalogs in a folder; '' if there is none."""
    path = folder / BLENDER
    if not os.path.lexists(path):
        return ""
    with contextlib.suppress(OSError, UnicodeDecodeError):
        text = path.read_text() if path.is_file() else ""  # reading a pipe would block
        if "VERSION 1" in text.splitlines():
            return text
    raise _foreign(path, "a list of Blender's catalogs")


def _blender_text(catalog: Catalog, folder: Path) -> str:
    first = (one_line(next(iter(tags))).replace(":", "-") for tags in catalog.tags().values())  # a line per catalog
    paths = {f"Materials/{tag}" for tag in first} | {"Materials"}
    return blender_catalog(paths, blender_list(folder))


def _write(path: Path, text: str) -> None:
    with temporary_beside(path) as temporary:
        temporary.write_text(text)


def _require_distinct(names: Sequence[str]) -> None:
    """Refuse names that are one on disks that ignore case or the form of accents: an asset would replace another."""
    seen: dict[str, str] = {}
    for name in names:
        other = seen.setdefault(unicodedata.normalize("NFC", name).casefold(), name)
        if other != name:
            raise ParameterError(
                f"{other} and {name} have one name on many disks", hint="export each to its own folder (--name)"
            )


def _require_replaceable(folder: Path) -> None:
    """Raise Error if a path exists that is not a folder of an asset (of any version)."""
    if os.path.lexists(folder) and (folder.is_symlink() or not _is_of(SCHEMA, folder / SIDECAR)):
        raise _foreign(folder, "an asset")


def _is_of(schema: str, path: Path) -> bool:
    """Whether a file is JSON of a schema, in any version."""
    with contextlib.suppress(Error, AttributeError):
        return str(read_document(path).get("schema")).partition("/")[0] == schema.partition("/")[0]
    return False


def _foreign(path: Path, kind: str) -> Error:
    return Error(f"{path} is not {kind} and would be overwritten; remove or rename it")


def _same(folder: Path, asset: Asset) -> bool:
    with contextlib.suppress(Error, KeyError):
        return bool(read_sidecar(folder)["key"] == asset.key)
    return False
