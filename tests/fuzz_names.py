# SPDX-License-Identifier: Apache-2.0
"""Hostile names in every string of every document: nothing outside of the given folders is created, changed or removed.

`python -m tests.fuzz_names 2000`. A case is a number: it chooses a kind of document, a string in it (a key or a value)
and a name. The document is then used as a person would use it. A canary tree around the given folders must stay as it
is, and its secret must not appear inside of them.
"""

from __future__ import annotations

import argparse
import asyncio
import base64
import contextlib
import copy
import io
import json
import os
import random
import shutil
import sqlite3
import stat
import tempfile
import traceback
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest import mock

import numpy as np
from oiiotex_studio.api.images import from_array
from oiiotex_studio.farm.openjd import share_template, write_template
from oiiotex_studio.library import asset as making
from oiiotex_studio.library import commands, ingest
from oiiotex_studio.library.catalog import FILE
from oiiotex_studio.library.runs import WORK
from oiiotex_studio.live.photos.opening import OpenPhoto, hub_of
from oiiotex_studio.live.photos.strip import PhotoStrip
from oiiotex_studio.live.photos.upload import Upload
from oiiotex_studio.materials import preview
from oiiotex_studio.recipes.found import materials
from oiiotex_studio.recipes.recipe import recipe_of

from oiiotex.engine.core.image import Image
from oiiotex.engine.errors import Error
from oiiotex.engine.session import Session
from tests import fuzz_documents
from tests.conftest import save

SECRET = b"what nobody else may read"
GIVEN = ("library", "out", "page", "case")  # below `given`: what a run may change
_DEEP = "a/b/c/d"  # where `given` lies: ../ leads to the canary tree
_RECIPE = {
    "schema": 1,
    "find": {"license": "CC0", "author": "me", "tags": ["green"], "normals": "opengl", "prefer": ["4k"]},
    "roles": {"color": {"words": ["kd"], "space": "srgb_rec709_scene"}},
    "product": [{"name": "tile", "line": "$maps $outputs"}],
    "deliver": {"format": "exr", "color": "lin_rec709_scene", "tx": False, "materialx": False},
    "judge": {"limits": ["height_steps>9"]},
    "assets": {
        "moss": {"tags": ["green"], "author": "me", "maps": {"color": "moss.png"}},
        "stone": {"maps": {"color": "scans.zip!stone_diff.png"}},
    },
}
_PLAIN = {name: value for name, value in _RECIPE.items() if name != "assets"}
_FACTS = {"license": "CC0", "author": "me", "tags": ["green"], "maps": {"color": "moss.png"}}


class World:
    """A canary tree, and in it the folders that a run is given.

    Attributes
    ----------
    given : Path
    precious : Path
        A folder of the canary tree that names lead to.
    """

    def __init__(self, top: Path):
        self.top, self.given, self.precious = top, top / _DEEP / "given", top / _DEEP / "precious"
        for folder in (top, *(top / up for up in ("a", "a/b", "a/b/c", _DEEP))):
            for below in ("precious", "precious/moss/k", "precious/tile"):
                (folder / below).mkdir(parents=True)
            for name in ("diary.txt", "card.jpg", "lock", "asset.json", "a.png", "moss/k/asset.json", "tile/color.exr"):
                (folder / "precious" / name).write_bytes(SECRET)
        photos = self.given / "photos"
        photos.mkdir(parents=True)
        (self.given / "here").mkdir()
        save(np.full((8, 8, 3), 0.5), photos / "moss.png")
        with zipfile.ZipFile(photos / "scans.zip", "w") as archive:
            archive.write(save(np.full((8, 8, 3), 0.7), self.given / "stone.png"), "stone_diff.png")
        with working():
            self.ingest(_RECIPE)
        self.whole = self.given / "whole"
        (self.given / "library").rename(self.whole)
        self.before = self.canary()

    @property
    def names(self) -> tuple[str, ...]:
        """Hostile names, and harmless ones that a person may choose."""
        ups = [f"{'../' * n}precious" for n in range(1, 8)]
        return (
            *ups, str(self.precious), str(self.precious / "a.png"), "../../../precious/moss/k", ".", "..", "", "/", "~",
            "$HOME", "moss/../../../precious", "tile/../../../../../precious", "assets/../../../precious", "a\nb", "\0",
            "x" * 300, "\u00e4" * 120, "<script>alert(1)</script>", "C:\\x", "..\\..\\precious", " moss", "moss.",
            "lock", ".making", "file:///etc/passwd", "{TOP.filename}", "scans.zip!../../../precious/a.png", "tile",
            "Moos gr\u00fcn",
        )  # fmt: skip

    def ingest(self, recipe: dict[str, Any], photos: str = "photos") -> None:
        """Bring the library up to date."""
        made = recipe_of(recipe, "recipe")
        line = ["ingest", str(self.given / photos), str(self.given / "library"), "--recipe", "r", "--workers", "1"]
        with mock.patch("oiiotex_studio.recipes.recipe.load_recipe", lambda path: made):
            commands.run(line)

    def use(self) -> None:
        """All commands on the library; an error ends one of them."""
        library, out = str(self.given / "library"), str(self.given / "out")
        for words in (["list"], ["show", "moss"], ["check"], ["export", out], ["export", out, "--name", "*"], ["gc"]):
            with contextlib.suppress(Error):
                commands.run([words[0], library, *words[1:]])
        with contextlib.suppress(Error):
            self.ingest(_RECIPE)
        with contextlib.suppress(Error):
            changed = copy.deepcopy(_RECIPE)
            changed["deliver"]["color"] = ""
            self.ingest(changed)
        for words in (["export", out], ["gc"]):
            with contextlib.suppress(Error):
                commands.run([words[0], library, *words[1:]])

    def renew(self) -> None:
        """Empty what the last case may have changed; the library is as it was."""
        for name in GIVEN:
            shutil.rmtree(self.given / name, ignore_errors=True)
            (self.given / name).unlink(missing_ok=True)
        shutil.copytree(self.whole, self.given / "library")
        (self.given / "case").mkdir()
        (self.given / "page").mkdir()

    def canary(self) -> dict[str, Any]:
        """All paths outside of what a run may change, with their content."""
        own = [self.given / name for name in GIVEN]
        return {
            str(path): (stat.S_IFMT(path.lstat().st_mode), path.read_bytes() if path.is_file() else None)
            for path in self.top.rglob("*")
            if not any(path.is_relative_to(one) for one in own)
        }

    def require_untouched(self) -> None:
        """AssertionError if the canary tree has changed, or its secret is in a given folder."""
        after = self.canary()
        wrong = sorted(p for p in after.keys() | self.before.keys() if after.get(p) != self.before.get(p))
        assert not wrong, f"changed outside: {wrong[:5]}"
        for name in GIVEN:
            for path in (self.given / name).rglob("*"):
                if path.is_file() and not any(one.is_symlink() for one in (path, *path.parents)):
                    content = path.read_bytes()
                    assert SECRET not in content and base64.b64encode(SECRET) not in content, f"leaked into {path}"


@contextlib.contextmanager
def working() -> Iterator[None]:
    """Jobs in this process, small pictures, nothing printed."""
    with contextlib.ExitStack() as stack:
        enter = stack.enter_context
        enter(mock.patch.object(ingest, "_in_processes", lambda jobs, _: ((making.make(job), job) for job in jobs)))
        for name in ("_THUMBNAIL", "_REPEATED", "LIT", "_RIVALS", "CARD"):
            enter(mock.patch.object(preview, name, 16))
        enter(contextlib.redirect_stdout(io.StringIO()))
        yield


# --- strings of a document ---


def strings_of(document: Any, place: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """The places of all strings; that of a key ends with None."""
    if isinstance(document, dict):
        keys = [(*place, key, None) for key in document]
        return keys + [found for key, value in document.items() for found in strings_of(value, (*place, key))]
    if isinstance(document, list):
        return [found for n, value in enumerate(document) for found in strings_of(value, (*place, n))]
    return [place] if isinstance(document, str) else []


def renamed(document: Any, place: tuple[Any, ...], name: str) -> Any:
    """The document with another string at a place."""
    document = copy.deepcopy(document)
    key = place[-2] if place[-1] is None else place[-1]
    at = document
    for step in place[: -2 if place[-1] is None else -1]:
        at = at[step]
    if place[-1] is None:
        at[name] = at.pop(key)
    else:
        at[key] = name
    return document


def hostile(document: Any, name: str, dice: random.Random) -> Any:
    """The document with the name in place of one of its strings."""
    return renamed(document, dice.choice(strings_of(document)), name)


# --- kinds of documents ---


def _recipe(world: World, name: str, dice: random.Random) -> None:
    place = dice.choice(strings_of(_RECIPE))
    place = dice.choice([("assets", "moss", None), ("assets", "stone", None), place])  # keys become folders
    world.ingest(renamed(_RECIPE, place, name))


def _facts(world: World, name: str, dice: random.Random) -> None:
    photos = world.given / "case"  # photos that come with facts
    shutil.copy(world.given / "photos/moss.png", photos)
    text = ""
    for key, value in sorted(hostile(_FACTS, name, dice).items(), key=lambda pair: isinstance(pair[1], dict)):
        pairs = value.items() if isinstance(value, dict) else [(key, value)]
        text += f"[{json.dumps(key)}]\n" if isinstance(value, dict) else ""
        text += "".join(f"{json.dumps(one)} = {json.dumps(other)}\n" for one, other in pairs)
    (photos / "moss.toml").write_text(text)
    world.ingest(_PLAIN, "case")


def _archive(world: World, name: str, dice: random.Random) -> None:
    photos = world.given / "case"
    member = dice.choice((f"{name}/rock_diff.png", f"{name}_diff.png", f"{name}.png", name)).replace("\0", "") or "x"
    link = zipfile.ZipInfo("link_diff.png")
    link.external_attr = (stat.S_IFLNK | 0o777) << 16
    with zipfile.ZipFile(photos / "rock.zip", "w") as archive:
        archive.writestr(member, (world.given / "stone.png").read_bytes())
        archive.writestr(link, str(world.precious / "a.png"))
    world.ingest(_PLAIN, "case")


def _catalog(world: World, name: str, dice: random.Random) -> None:
    with contextlib.closing(sqlite3.connect(world.given / "library" / FILE)) as data:
        tables = [row[0] for row in data.execute("SELECT name FROM sqlite_master WHERE type='table'")]
        table = dice.choice([*tables, *["assets"] * len(tables)])
        column = dice.choice([row[1] for row in data.execute(f"PRAGMA table_info({table})")])
        column = dice.choice([column, "name", "folder"]) if table == "assets" else column
        value = json.dumps([name]) if dice.random() < 0.2 else name
        one = " WHERE name = 'moss'" if table == "assets" else ""
        with contextlib.suppress(sqlite3.Error):  # the same name twice, or no text in its encoding
            data.execute(f"UPDATE {table} SET {column} = ?{one}", (value,))
            data.commit()
    world.use()


def _sidecar(world: World, name: str, dice: random.Random) -> None:
    library = world.given / "library"
    for path in sorted(library.glob("assets/*/*/asset.json"))[: dice.choice((1, 2))]:
        path.write_text(json.dumps(hostile(json.loads(path.read_text()), name, dice)))
    if dice.random() < 0.5:  # ingest then reads the folders
        for path in library.glob(f"{FILE}*"):
            path.unlink()
        with contextlib.suppress(Error):
            world.ingest(_RECIPE)
    world.use()


def _links(world: World, name: str, dice: random.Random) -> None:
    """A library that was received with a link in it."""
    library = world.given / "library"
    (library / WORK / "run-0").mkdir(parents=True, exist_ok=True)
    (library / "review").mkdir(exist_ok=True)
    there = sorted(path for path in library.rglob("*") if not path.name.startswith(FILE))
    new = [library / "review/moss", library / WORK / "lock", library / WORK / "run-0/lock", library / WORK / "run-1",
           *(path / "more" for path in library.glob("assets/*/*"))]  # fmt: skip
    path = dice.choice([*there, *new])
    folder = path.is_dir() or (not path.exists() and path.suffix == "" and path.name != "lock")
    if path.is_dir():
        shutil.rmtree(path)
    path.unlink(missing_ok=True)
    inside = dice.choice(("moss", "")) if folder else dice.choice(("diary.txt", "card.jpg", "asset.json", "new.txt"))
    path.symlink_to(world.precious / inside)
    if dice.random() < 0.3:
        (library / "report.html").unlink(missing_ok=True)
    world.use()


def _job(world: World, name: str, dice: random.Random) -> None:
    library = world.given / "library"
    recipe = recipe_of(_RECIPE, "recipe")
    material = next(one for one in materials(world.given / "photos", recipe) if one.name == "moss")
    (before,) = library.glob("assets/moss/*")
    job = making.AssetJob(
        material, recipe, str(world.given / "photos"), str(library), str(library / WORK / "run-0/assets/moss"),
        str(before), (("color", "0" * 64),), 1 << 30, 1,
    )  # fmt: skip
    field = dice.choice(("work", "work", "before", "photos", "library", "material"))
    if field == "material":
        job = job._replace(material=material.__class__(name, material.maps, material.facts))
    else:
        joined = str(library / WORK / name.replace("\0", "")) if dice.random() < 0.5 else name
        job = job._replace(**{field: joined})
    making.make(job)


def _page(world: World, name: str, dice: random.Random) -> None:
    folder = world.given / "page"
    (folder / "link.png").symlink_to(world.precious / "new.png")
    named = dice.choice((name, f"{name}.png", f"{name}/a.png", "link.png"))
    if dice.random() < 0.3:
        Upload(folder, named, 3).take(b"abc")
        return
    told = mock.Mock()
    if dice.random() < 0.3:
        asked = {"do": "upload", "name": named, "offset": 0, "size": 3}
        PhotoStrip(Session(), folder).answer(told, asked, b"abc")
        return

    async def saved() -> None:
        photo = OpenPhoto(Image(from_array(np.zeros((8, 8, 3), np.float32)).parts, "moss.png"), ("moss.png",))
        hub = hub_of(photo, Session(), folder)
        hub.document.save()
        try:
            hub.change("output", {"tile": named})
            hub.document.save()
            read = SimpleNamespace(result=lambda: (None, (np.zeros((8, 8, 3), np.float32),)))
            hub._client = SimpleNamespace(ended=False, read=lambda *_, **__: read, close=lambda: None)
            facts = {"name": "", "place": [0, 0, 8, 8, 0, 0, 8, 8], "type": "float", "channels": ["R", "G", "B"],
                     "alpha": -1, "stored": None, "exact": False, "attributes": []}  # fmt: skip
            await hub.save({"number": 1, "parts": [facts]}, *hub.output("tile"), "tile")
        finally:
            hub.close()

    asyncio.run(saved())


def _template(world: World, name: str, dice: random.Random) -> None:
    """A job template that exists is replaced; its strings, and those of the line, are no paths."""
    folder = world.given / "case"
    template = hostile(share_template("job", ["a.png", "-o", "b.exr"], 2, 64), name, dice)
    (folder / "job.json").write_text(json.dumps(template))
    line = ["a.png", "-o", name.replace("\0", "")]
    write_template(folder / "job.json", share_template(name, line, 2, 64), line)


def _other(world: World, name: str, dice: random.Random) -> None:
    """The other JSON documents, each by its own reader."""
    folder = world.given / "case"
    kind = dice.choice([kind for kind in fuzz_documents.KINDS if kind.name.endswith((".json", ".oiiotex"))])
    save(np.zeros((8, 8, 3)), folder / "photo.png")
    (folder / kind.name).write_text(json.dumps(hostile(kind.whole(folder), name, dice)))
    kind.read(folder / kind.name)


KINDS: tuple[Callable[[World, str, random.Random], None], ...] = (
    _recipe, _facts, _archive, _catalog, _sidecar, _links, _job, _page, _template, _other,
)  # fmt: skip


def case(world: World, number: int) -> None:
    """Use the document of that number; AssertionError if something outside has changed or leaked."""
    dice = random.Random(number)
    kind, name = KINDS[number % len(KINDS)], dice.choice(world.names)
    with contextlib.chdir(world.given / "here"), working():
        world.renew()
        try:
            kind(world, name, dice)
        except Error as error:
            assert str(error) and str(error).isprintable(), repr(str(error))
    world.require_untouched()


def faults_of(numbers: range, folder: Path) -> list[str]:
    """Lines about the cases that fail."""
    told, world = [], World(folder / "world")
    for number in numbers:
        try:
            case(world, number)
        except Exception as error:
            at = traceback.extract_tb(error.__traceback__)[-1]
            kind = KINDS[number % len(KINDS)].__name__[1:]
            told.append(f"{number} {kind}: {type(error).__name__} {error} at {at.filename}:{at.lineno}"[:900])
            world = World(folder / f"world{number}")
    return told


def main() -> None:
    """Try as many cases as are asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("count", type=int)
    parser.add_argument("--begin", type=int, default=0, help="the first number")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        os.environ["XDG_RUNTIME_DIR"] = folder
        told = faults_of(range(given.begin, given.begin + given.count), Path(folder))
    print("\n".join([f"names: {given.count} read, {len(told)} wrong", *map(ascii, told)]), flush=True)


if __name__ == "__main__":
    main()
