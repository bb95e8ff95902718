# SPDX-License-Identifier: Apache-2.0
"""Maintenance of a library: show, check and clean up."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from oiiotex.engine.errors import Error

from ..api.files import owned, remove_folder
from ..materials.documents import has_materialx, materialx_faults, usd_faults
from .asset import read_sidecar
from .catalog import PLACES, SIDECAR, Catalog
from .digests import faults
from .runs import WORK


def check(catalog: Catalog) -> Iterator[str]:
    """Yield the errors of a library: wrong hashes, invalid documents.

    Folders that are not in the catalog are not errors: a run was killed, or a newer asset has replaced them.
    """
    yield from catalog.faults()
    materialx = has_materialx()
    for asset in catalog.assets().values():
        if not asset.folder:
            continue
        folder = owned(catalog.library / asset.folder, catalog.library)
        rows = catalog.files(asset.name)
        yield from faults(folder, [{"path": path, "bytes": size, "sha256": digest} for path, _, size, digest in rows])
        try:
            sidecar = read_sidecar(folder)
            documents = [owned(path, folder) for path in sorted(folder.glob("*.mtlx"))] if materialx else []
            stage = owned(folder / f"{asset.name}.usda", folder)
        except Error as error:
            yield str(error)
            continue
        if (sidecar["name"], sidecar["key"], sidecar["status"]) != asset[:3]:
            yield f"{folder / SIDECAR} does not match the catalog"
        for document in documents:
            yield from dict.fromkeys(materialx_faults(document))
        if stage.is_file():
            yield from dict.fromkeys(usd_faults(stage))


def orphans(catalog: Catalog) -> list[Path]:
    """Folders of assets that a newer folder has replaced.

    The folder of a material that now fails is kept. So is a folder that is missing in the catalog: `ingest` records it.
    """
    assets, library = catalog.assets(), catalog.library
    named = {asset.folder for asset in assets.values() if asset.folder}
    replaced = {asset.name for asset in assets.values() if asset.folder}
    folders = [folder for place in PLACES for folder in sorted((library / place).glob("*/*")) if folder.is_dir()]
    return [
        folder
        for folder in folders
        if folder.relative_to(library).as_posix() not in named and folder.parent.name in replaced
    ]


def collect_garbage(catalog: Catalog) -> tuple[int, int]:
    """Remove the folders of replaced assets; returns the numbers of folders and bytes."""
    with catalog.run() as run:
        if len(list((catalog.library / WORK).glob("run-*"))) > 1:
            raise Error(f"{catalog.library}: another run is active; run gc after it has ended")
        folders, freed = [owned(folder, catalog.library) for folder in orphans(catalog)], 0
        for number, folder in enumerate(folders):
            freed += sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())
            aside = catalog.library / WORK / run / str(number)
            folder.rename(aside)  # atomic; if this run is killed, a later one removes it
            remove_folder(aside, catalog.library / WORK)
            with contextlib.suppress(OSError):  # another version exists
                folder.parent.rmdir()
    return len(folders), freed


def shown(catalog: Catalog, name: str) -> dict[str, Any]:
    """All data of an asset."""
    asset = catalog.asset(name)
    if asset is None:
        raise Error(f"{catalog.library}: no asset '{name}'; see oiiotex-library list {catalog.library}")
    facts: dict[str, Any] = {
        "name": asset.name, "status": asset.status, "reasons": list(asset.reasons), "photos": asset.root,
    }  # fmt: skip
    if asset.folder:
        folder = owned(catalog.library / asset.folder, catalog.library)
        facts |= {"folder": str(folder)} | read_sidecar(folder)
    return facts
