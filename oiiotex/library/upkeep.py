# SPDX-License-Identifier: Apache-2.0
"""A library looked after: searched, checked, tidied, handed on."""

from __future__ import annotations

import contextlib
import fnmatch
import json
import math
import os
import re
import shutil
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..errors import Error, ParameterError
from ..io.atomic import temporary_beside
from ..materials import documents
from ..recipes.recipe import Limit
from .asset import SCHEMA, SIDECAR, faults, read_sidecar
from .catalogue import WORK, Asset, Catalogue

PLACES = ("assets", "review")
_HEX = re.compile(r"#?([0-9a-fA-F]{6})")
_SIZE = re.compile(r"([<>]?)(\d+)x(\d+)")


@dataclass(frozen=True)
class Search:
    """What is looked for; '' and () ask for nothing.

    Attributes
    ----------
    name : str
        With * and ?.
    status, tag : str
    measures : tuple of str
        NAME>NUMBER or NAME<NUMBER: all must hold.
    color : str
        RRGGBB in sRGB.
    distance : float
        From it to the mean colour, Lab, at most.
    size : str
        WIDTHxHEIGHT; behind > or <: larger or smaller along both sides, or equal.
    """

    name: str = ""
    status: str = ""
    tag: str = ""
    measures: tuple[str, ...] = ()
    color: str = ""
    distance: float = 15.0
    size: str = ""

    def assets(self, catalogue: Catalogue) -> list[tuple[Asset, dict[str, float]]]:
        """What fits, with its measures; by colour the nearest first, else by name.

        Raises
        ------
        ParameterError
            A term is none.
        """
        limits = [Limit.read(text) for text in self.measures]
        lab, fits = _lab(self.color), _size(self.size)
        measures = catalogue.measures()
        tags = catalogue.tags() if self.tag else {}
        chosen = []
        for asset in catalogue.assets().values():
            own = measures.get(asset.name, {})
            if (
                (not self.name or fnmatch.fnmatchcase(asset.name, self.name))
                and self.status in ("", asset.status)
                and (not self.tag or self.tag in tags.get(asset.name, {}))
                and all(limit.measure in own and limit.passed_by(own[limit.measure]) for limit in limits)
                and fits(asset)
                and (not lab or (asset.lab and math.dist(lab, asset.lab) <= self.distance))
            ):
                chosen.append((asset, own))
        if lab:
            chosen.sort(key=lambda pair: math.dist(lab, pair[0].lab))
        return chosen


def check(catalogue: Catalogue) -> Iterator[str]:
    """What is wrong with a library: every file is hashed, every document validated.

    Folders that the catalogue does not name are no fault: a run was killed, or a newer asset took their place.
    """
    yield from catalogue.faults()
    materialx = documents.has_materialx()
    for asset in catalogue.assets().values():
        if not asset.folder:
            continue
        folder = catalogue.library / asset.folder
        rows = catalogue.files(asset.name)
        yield from faults(folder, [{"path": path, "bytes": size, "sha256": digest} for path, _, size, digest in rows])
        try:
            sidecar = read_sidecar(folder)
        except Error as error:
            yield str(error)
            continue
        if (sidecar["name"], sidecar["key"], sidecar["status"]) != asset[:3]:
            yield f"{folder / SIDECAR}: says something else than the catalogue"
        document = folder / f"{asset.name}.mtlx"
        if materialx and document.is_file():
            yield from dict.fromkeys(documents.materialx_faults(document))


def orphans(catalogue: Catalogue) -> list[Path]:
    """Folders of assets that the catalogue does not name; what was made of one that now fails is none."""
    assets, library = catalogue.assets(), catalogue.library
    named = {asset.folder for asset in assets.values()}
    without = {asset.name for asset in assets.values() if not asset.folder}
    folders = [folder for place in PLACES for folder in sorted((library / place).glob("*/*")) if folder.is_dir()]
    return [
        folder
        for folder in folders
        if folder.relative_to(library).as_posix() not in named and folder.parent.name not in without
    ]


def collect_garbage(catalogue: Catalogue) -> tuple[int, int]:
    """Remove what the catalogue does not name: (folders, bytes).

    Raises
    ------
    Error
        A run is at work: what it has made and not yet recorded would go.
    """
    with catalogue.run() as run:
        if len(list((catalogue.library / WORK).glob("run-*"))) > 1:
            raise Error(f"{catalogue.library}: a run is at work: gc when it has ended")
        folders, freed = orphans(catalogue), 0
        for number, folder in enumerate(folders):
            freed += sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())
            aside = catalogue.library / WORK / run / str(number)
            folder.rename(aside)  # gone in one go, and swept if this is killed
            shutil.rmtree(aside, ignore_errors=True)
            with contextlib.suppress(OSError):  # another version is there
                folder.parent.rmdir()
    return len(folders), freed


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


def shown(catalogue: Catalogue, name: str) -> dict[str, Any]:
    """All that is known of an asset.

    Raises
    ------
    Error
        There is none of that name.
    """
    asset = catalogue.asset(name)
    if asset is None:
        raise Error(f"{catalogue.library}: no asset '{name}': oiiotex-library list {catalogue.library} lists them")
    facts: dict[str, Any] = {
        "name": asset.name, "status": asset.status, "reasons": list(asset.reasons), "photos": asset.root,
    }  # fmt: skip
    if asset.folder:
        facts |= {"folder": str(catalogue.library / asset.folder)} | read_sidecar(catalogue.library / asset.folder)
    return facts


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


def _lab(text: str) -> tuple[float, ...]:
    if not text:
        return ()
    match = _HEX.fullmatch(text)
    if not match:
        raise ParameterError(f"--color {text}: allowed is RRGGBB")
    from ..materials.preview import lab_of_srgb

    return tuple(lab_of_srgb([int(match[1][n : n + 2], 16) / 255 for n in (0, 2, 4)]))


def _size(text: str) -> Callable[[Asset], bool]:
    if not text:
        return lambda asset: True
    match = _SIZE.fullmatch(text)
    if not match:
        raise ParameterError(f"--size {text}: allowed is WIDTHxHEIGHT, and > or < before it")
    width, height = int(match[2]), int(match[3])
    if match[1] == ">":
        return lambda asset: asset.width >= width and asset.height >= height
    if match[1] == "<":
        return lambda asset: 0 < asset.width <= width and 0 < asset.height <= height
    return lambda asset: (asset.width, asset.height) == (width, height)
