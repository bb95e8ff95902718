# SPDX-License-Identifier: Apache-2.0
"""The catalog of a library, a SQLite database: assets, files, measures, failures, and assets claimed by runs.

The folders with their asset.json are authoritative. The catalog indexes them, and is updated after them, in one
transaction per asset. It must be on a local disk of the machine that runs `ingest`, because SQLite's write-ahead log
requires shared memory. Workers on other machines only write folders.
"""

from __future__ import annotations

import contextlib
import json
import sqlite3
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from oiiotex.engine.errors import Error, within

from ..api.files import checked_name, remove_folder
from .runs import CAN_LOCK, FILE, WORK, folder_of_run, lock, locked, require_no_links, sqlite_errors

STATUSES = ("failed", "asked", "review", "ok")  # the most urgent first
PLACES = ("assets", "review")  # parents of asset folders
SIDECAR = "asset.json"  # describes the asset of a folder
_VERSION = 2
_PATIENCE = 60.0  # s; timeout of a writer that waits for another
_TABLES = """
CREATE TABLE assets (
    name TEXT PRIMARY KEY, key TEXT NOT NULL, status TEXT NOT NULL, folder TEXT NOT NULL, reasons TEXT NOT NULL,
    root TEXT NOT NULL, license TEXT, author TEXT, width INTEGER, height INTEGER, size_m TEXT,
    l REAL, a REAL, b REAL, seconds REAL, made TEXT NOT NULL);
CREATE TABLE files (
    asset TEXT NOT NULL REFERENCES assets ON DELETE CASCADE, path TEXT NOT NULL, role TEXT NOT NULL,
    bytes INTEGER NOT NULL, sha256 TEXT NOT NULL, PRIMARY KEY (asset, path)) WITHOUT ROWID;
CREATE TABLE measures (
    asset TEXT NOT NULL REFERENCES assets ON DELETE CASCADE, name TEXT NOT NULL, value REAL NOT NULL,
    PRIMARY KEY (asset, name)) WITHOUT ROWID;
CREATE TABLE tags (
    asset TEXT NOT NULL REFERENCES assets ON DELETE CASCADE, tag TEXT NOT NULL, PRIMARY KEY (asset, tag)) WITHOUT ROWID;
CREATE TABLE labels (
    asset TEXT NOT NULL REFERENCES assets ON DELETE CASCADE, number INTEGER NOT NULL, name TEXT NOT NULL,
    share REAL NOT NULL, l REAL NOT NULL, a REAL NOT NULL, b REAL NOT NULL,
    PRIMARY KEY (asset, number)) WITHOUT ROWID;
CREATE TABLE sources (
    path TEXT PRIMARY KEY, bytes INTEGER NOT NULL, changed INTEGER NOT NULL, sha256 TEXT NOT NULL) WITHOUT ROWID;
CREATE TABLE claims (asset TEXT PRIMARY KEY, run TEXT NOT NULL) WITHOUT ROWID;
"""

_ASSETS = (
    "SELECT CAST(name AS TEXT), key, status, CAST(folder AS TEXT), reasons, root, license, author,"
    " CAST(width AS INTEGER), CAST(height AS INTEGER), size_m, CAST(l AS REAL), CAST(a AS REAL), CAST(b AS REAL),"
    " CAST(seconds AS REAL), made FROM assets"
)


class Asset(NamedTuple):
    """A row of the catalog."""

    name: str
    key: str
    status: str  # ok; review: exceeds a limit; failed: not made; asked: the recipe must answer a question
    folder: str = ""  # Below the library; '' if there is none
    reasons: tuple[str, ...] = ()  # Why it is not ok
    root: str = ""  # The folder of photos that contains its material
    license: str = ""
    author: str = ""
    width: int = 0
    height: int = 0
    size_m: tuple[float, ...] = ()
    lab: tuple[float, ...] = ()  # Mean color; () if unknown
    seconds: float = 0.0
    made: str = ""


class AssetLabel(NamedTuple):
    """A label of an asset: its name, its share of the pixels, its mean color in CIE Lab."""

    name: str
    share: float
    lab: tuple[float, ...]


class Catalog:
    """The catalog of a library.

    Parameters
    ----------
    library : Path
    create : bool
        Create library and catalog if they do not exist.
    recorded : bool
        False: a catalog of this run alone, in memory, on a farm machine that only writes folders. A later run records
        them, and removes what killed runs left.

    Raises
    ------
    Error
        The catalog is missing, has another version, is damaged, or is empty although there are assets.
    """

    def __init__(self, library: Path, create: bool = False, recorded: bool = True):
        self.library, self._recorded = library, recorded
        path = library / FILE
        if not create and not path.is_file():
            raise Error(f"{library} is not a library; create one with oiiotex-library ingest PHOTOS {library}")
        with sqlite_errors(library):
            (library / WORK).mkdir(parents=True, exist_ok=True)
            require_no_links(library)
            self._data = sqlite3.connect(path if recorded else ":memory:", timeout=_PATIENCE, isolation_level=None)
            self._data.execute("PRAGMA journal_mode=WAL")
            self._data.execute("PRAGMA synchronous=NORMAL")
            self._data.execute("PRAGMA foreign_keys=ON")
            self._prepare()
            if not create:
                self._require_filled()

    def _require_filled(self) -> None:
        """Raise Error for an empty catalog alongside folders of assets, which would be ignored or removed."""
        if self._data.execute("SELECT 1 FROM assets LIMIT 1").fetchone():
            return
        if any(next((self.library / place).glob(f"*/*/{SIDECAR}"), None) for place in PLACES):
            hint = "run ingest again, which restores the catalog"
            raise Error(f"{self.library / FILE} is empty, but the library has assets; {hint}")

    def _prepare(self) -> None:
        with self._transaction():
            (version,) = self._data.execute("PRAGMA user_version").fetchone()
            if version == 0:
                for statement in _TABLES.split(";"):
                    self._data.execute(statement)
                self._data.execute(f"PRAGMA user_version={_VERSION}")
            elif version != _VERSION:
                hint = f"remove {FILE}* and run ingest again"
                raise Error(f"{self.library}: library version {version}: expected {_VERSION}; {hint}")

    def __enter__(self) -> Catalog:
        return self

    def __exit__(self, *_: object) -> None:
        self._data.close()

    @contextlib.contextmanager
    def _transaction(self) -> Iterator[None]:
        """An exclusive transaction, rolled back on errors."""
        with sqlite_errors(self.library):
            try:  # a signal may arrive between any two of these lines
                self._data.execute("BEGIN IMMEDIATE")
                yield
                self._data.execute("COMMIT")
            except BaseException:
                if self._data.in_transaction:
                    self._data.execute("ROLLBACK")
                raise

    # --- reading ---

    def assets(self) -> dict[str, Asset]:
        """All assets by name, sorted."""
        with sqlite_errors(self.library):
            return {row[0]: self._asset(row) for row in self._data.execute(f"{_ASSETS} ORDER BY name")}

    def asset(self, name: str) -> Asset | None:
        """The asset with a name."""
        with sqlite_errors(self.library):
            row = self._data.execute(f"{_ASSETS} WHERE name = ?", (name,)).fetchone()
        return self._asset(row) if row else None

    def _asset(self, row: Sequence[Any]) -> Asset:
        """The asset of a row. The library can come from others, so its names are checked before they become paths."""
        with within(str(self.library / FILE)):
            for name in (row[0], *(row[3].split("/") if row[3] else ())):
                checked_name(name, "asset")
            try:
                reasons, tile = (tuple(json.loads(row[column])) for column in (4, 10))
                "".join(map(str, reasons)).encode()  # JSON can hold half a surrogate pair, which cannot be printed
            except (ValueError, TypeError, RecursionError) as error:
                raise Error(f"asset '{row[0]}': {error}: expected lists") from error
            if row[2] not in STATUSES:
                raise Error(f"asset '{row[0]}': status '{row[2]}': expected {', '.join(STATUSES)}")
        lab = tuple(row[11:14]) if row[11] is not None else ()
        return Asset._make([*row[:4], reasons, *row[5:10], tile, lab, row[14] or 0.0, row[15]])

    def measures(self) -> dict[str, dict[str, float]]:
        """The measures of all assets, by asset and measure."""
        return self._gathered("SELECT asset, name, CAST(value AS REAL) FROM measures")

    def tags(self) -> dict[str, dict[str, str]]:
        """The tags of all assets: asset -> tags as keys."""
        return self._gathered("SELECT asset, tag, tag FROM tags")

    def sizes(self) -> dict[str, int]:
        """The bytes of the files of all assets."""
        with sqlite_errors(self.library):
            return dict(self._data.execute("SELECT asset, SUM(bytes) FROM files GROUP BY asset"))

    def labels(self) -> dict[str, list[AssetLabel]]:
        """The labels of assets with labels."""
        gathered: dict[str, list[AssetLabel]] = {}
        with sqlite_errors(self.library):
            for asset, name, share, *lab in self._data.execute(
                "SELECT asset, name, CAST(share AS REAL), CAST(l AS REAL), CAST(a AS REAL), CAST(b AS REAL)"
                " FROM labels ORDER BY asset, number"
            ):
                gathered.setdefault(asset, []).append(AssetLabel(name, share, tuple(lab)))
        return gathered

    def _gathered(self, query: str) -> dict[str, dict[str, Any]]:
        gathered: dict[str, dict[str, Any]] = {}
        with sqlite_errors(self.library):
            for asset, name, value in self._data.execute(query):
                gathered.setdefault(asset, {})[name] = value
        return gathered

    def files(self, asset: str) -> list[tuple[str, str, int, str]]:
        """An asset's files: (path in its folder, role, bytes, SHA-256)."""
        query = "SELECT CAST(path AS TEXT), role, bytes, sha256 FROM files WHERE asset = ? ORDER BY path"
        with sqlite_errors(self.library):
            return list(self._data.execute(query, (asset,)))

    def sources(self) -> dict[str, tuple[int, int, str]]:
        """Hashed files: path -> (bytes, modification time in ns, SHA-256)."""
        with sqlite_errors(self.library):
            rows = self._data.execute("SELECT path, bytes, changed, sha256 FROM sources")
            return {path: (size, changed, digest) for path, size, changed, digest in rows}

    def faults(self) -> list[str]:
        """Errors that SQLite finds in the database."""
        with sqlite_errors(self.library):
            rows = [text for (text,) in self._data.execute("PRAGMA integrity_check")]
            rows += [f"a row of {row[0]} without its asset" for row in self._data.execute("PRAGMA foreign_key_check")]
        return [text for text in rows if text != "ok"]

    # --- writing ---

    def remember_sources(self, rows: Iterable[tuple[str, int, int, str]]) -> None:
        """Store the hashes of files."""
        with self._transaction():
            self._data.executemany("INSERT OR REPLACE INTO sources VALUES (?, ?, ?, ?)", rows)

    def put(
        self,
        asset: Asset,
        files: Sequence[tuple[str, str, int, str]] = (),
        measures: Mapping[str, float] | None = None,
        tags: Sequence[str] = (),
        labels: Sequence[AssetLabel] = (),
    ) -> None:
        """Insert or replace an asset."""
        self.put_all([(asset, files, measures or {}, tags, labels)])

    def put_all(
        self, rows: Iterable[tuple[Asset, Sequence[Any], Mapping[str, float], Sequence[str], Sequence[AssetLabel]]]
    ) -> None:
        """Insert or replace assets, given as (asset, files, measures, tags, labels), in one transaction."""
        with self._transaction():
            for asset, files, measures, tags, labels in rows:
                self._data.execute("DELETE FROM assets WHERE name = ?", (asset.name,))
                lab = asset.lab or (None,) * 3
                values = (
                    *asset[:4], json.dumps(asset.reasons), *asset[5:10], json.dumps(asset.size_m), *lab, *asset[12:],
                )  # fmt: skip
                self._data.execute(f"INSERT INTO assets VALUES ({', '.join('?' * len(values))})", values)
                name = asset.name
                self._data.executemany("INSERT INTO files VALUES (?, ?, ?, ?, ?)", [(name, *row) for row in files])
                self._data.executemany("INSERT INTO measures VALUES (?, ?, ?)", [(name, *m) for m in measures.items()])
                self._data.executemany("INSERT INTO tags VALUES (?, ?)", [(name, tag) for tag in dict.fromkeys(tags)])
                rows_of_labels = [(name, n, called, share, *lab) for n, (called, share, lab) in enumerate(labels)]
                self._data.executemany("INSERT INTO labels VALUES (?, ?, ?, ?, ?, ?, ?)", rows_of_labels)

    # --- runs ---

    @contextlib.contextmanager
    def run(self) -> Iterator[str]:
        """A context with a separate folder below `WORK` for a run; leftovers of dead runs are removed."""
        self.sweep()
        with folder_of_run(self.library) as name:
            try:
                yield name
            finally:
                with self._transaction():
                    self._data.execute("DELETE FROM claims WHERE run = ?", (name,))

    def sweep(self) -> None:
        """Remove leftovers of killed runs, if the catalog is recorded."""
        if self._recorded:
            with locked(self.library / WORK / "lock"):
                self._sweep()

    def _sweep(self) -> None:
        """Remove folders and claims of dead runs, whose locks the system has released."""
        if not CAN_LOCK:  # without locks, dead runs cannot be recognized
            return
        live = []
        for folder in (self.library / WORK).glob("run-*"):
            try:
                with open(folder / "lock", "wb") as file:
                    dead = lock(file.fileno(), wait=False)
            except OSError:
                dead = True
            if dead:
                remove_folder(folder, self.library / WORK)
            else:
                live.append(folder.name)
        with self._transaction():
            marks = ", ".join("?" * len(live))
            self._data.execute(f"DELETE FROM claims WHERE run NOT IN ({marks})", live)

    def claim(self, asset: str, run: str) -> bool:
        """Claim an asset for a run; False if another run has claimed it."""
        with self._transaction():
            self._data.execute("INSERT OR IGNORE INTO claims VALUES (?, ?)", (asset, run))
            (owner,) = self._data.execute("SELECT run FROM claims WHERE asset = ?", (asset,)).fetchone()
        return bool(owner == run)

    def release(self, asset: str, run: str) -> None:
        """Release the claim of an asset."""
        with self._transaction():
            self._data.execute("DELETE FROM claims WHERE asset = ? AND run = ?", (asset, run))
