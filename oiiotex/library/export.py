# SPDX-License-Identifier: Apache-2.0
"""Assets handed on: copied into a folder, each under its name, with an index and Blender's catalogue."""

from __future__ import annotations

import contextlib
import json
import os
import shutil
from collections.abc import Callable, Sequence
from pathlib import Path

from ..errors import Error, ParameterError
from ..io.atomic import temporary_beside
from ..materials import documents
from .asset import SCHEMA, SIDECAR, read_sidecar
from .catalogue import Asset, Catalogue


def export(catalogue: Catalogue, target: Path, chosen: Sequence[Asset], done: Callable[[str], object]) -> int:
    """Copy assets into a folder, each under its name, with an index and Blender's catalogue; returns how many.

    Raises
    ------
    Error
        The folder cannot be written, lies in the library, or has a folder of an asset's name that is none.
    """
    count, index = 0, []
    if target.resolve().is_relative_to(catalogue.library.resolve()):
        raise ParameterError(f"{target}: lies in the library: export to a folder outside of it")
    for asset in chosen:
        _require_replaceable(target / asset.name)
    try:
        target.mkdir(parents=True, exist_ok=True)
        for asset in chosen:
            if not asset.folder:
                continue
            source, final = catalogue.library / asset.folder, target / asset.name
            index.append(asset.name)
            if _same(final, asset):
                continue
            aside = target / f".{asset.name}-{os.urandom(6).hex()}"
            shutil.copytree(source, aside)
            if final.is_dir():
                old = target / f".{asset.name}-{os.urandom(6).hex()}"
                final.rename(old)
                aside.rename(final)
                shutil.rmtree(old, ignore_errors=True)
            else:
                aside.rename(final)
            count += 1
            done(asset.name)
    except OSError as error:
        raise Error(f"{target}: {error}") from error
    write_blender(catalogue, target)
    with temporary_beside(target / "index.json") as temporary:
        temporary.write_text(json.dumps({"schema": "oiiotex.export/1", "assets": index}, indent=1) + "\n")
    return count


def write_blender(catalogue: Catalogue, folder: Path) -> None:
    """Blender's list of catalogues: one for each first tag, and one for what has none."""
    paths = {f"Materials/{next(iter(tags))}" for tags in catalogue.tags().values()} | {"Materials"}
    with temporary_beside(folder / documents.BLENDER) as temporary:
        temporary.write_text(documents.blender_catalogue(paths))


def _require_replaceable(folder: Path) -> None:
    """Refuse what is no asset's folder, of whatever version: it is the user's."""
    if not os.path.lexists(folder):
        return
    with contextlib.suppress(OSError, ValueError, AttributeError):
        schema = json.loads((folder / SIDECAR).read_bytes()).get("schema")
        if not folder.is_symlink() and str(schema).partition("/")[0] == SCHEMA.partition("/")[0]:
            return
    raise Error(f"{folder}: is no asset, and would be replaced by one: remove it, or export to another folder")


def _same(folder: Path, asset: Asset) -> bool:
    with contextlib.suppress(Error, KeyError):
        return bool(read_sidecar(folder)["key"] == asset.key)
    return False
