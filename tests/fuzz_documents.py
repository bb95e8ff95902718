# SPDX-License-Identifier: Apache-2.0
"""Documents that are broken at random, each with its own reader: `python -m tests.fuzz_documents 10000`.

A reader takes a broken document or raises an `oiiotex.Error`. The number of a case never changes what it stands for.
"""

from __future__ import annotations

import argparse
import contextlib
import copy
import functools
import json
import random
import resource
import shutil
import signal
import sqlite3
import subprocess
import sys
import tempfile
import traceback
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import OpenImageIO as oiio
from oiiotex_studio.library.asset import SCHEMA, SIDECAR, read_sidecar
from oiiotex_studio.library.catalog import FILE, Catalog
from oiiotex_studio.library.digests import faults
from oiiotex_studio.live.document import Document, default_state
from oiiotex_studio.recipes.found import extract, materials
from oiiotex_studio.recipes.lines import require_lines
from oiiotex_studio.recipes.recipe import commented_recipe, facts_beside, load_recipe, recipe_of

from oiiotex.analysis.labels.legend import LabelNames
from oiiotex.engine.core.window import Window
from oiiotex.engine.errors import Error
from oiiotex.engine.io.checkpoint import Checkpoint
from oiiotex.engine.io.disk_cache import cached_arrays
from oiiotex.oiiotool.cli.running.line_run import run
from oiiotex.oiiotool.service.texture_file import read_texture_file
from oiiotex.surfaces.atlas.mesh import read_mesh
from oiiotex.synthesis.multiscale.graph import read_graph
from tests import fuzz
from tests.conftest import save

_BYTES = 8 << 30  # of address space that a process of cases may have
_SECONDS = 20  # that one case may take
_CHUNK = 300  # cases of one process
# what a value of a JSON document is replaced by
_ODD: tuple[Any, ...] = (
    None, True, False, 0, -1, 1, 1 << 31, 1 << 63, 1e308, -0.5, 10**400, "", "x", "../../x", "/etc/passwd", "\0",
    "\ud800", "%s{}", "x" * 9000, [], {}, [[]], {"": None}, [None] * 99, "nan", "1,2,3", "0x0", "99999x99999",
)  # fmt: skip
VIEWS = {"d": ["v"]}


class Kind(NamedTuple):
    """A kind of document."""

    name: str  # of its file
    whole: Callable[[Path], Any]  # bytes, or what JSON says
    read: Callable[[Path], None]


# --- whole documents ---


def _names() -> dict[str, Any]:
    labels = [{"id": n, "number": n, "name": f"moss {n}", "color": f"{40 * n},0,0", "swatch": [0, 0, 8, 8],
               "share": 0.5} for n in (1, 2)]  # fmt: skip
    finer = [entry | {"id": 1, "number": 3, "color": "0,9,0", "parents": [1]} for entry in labels[:1]]
    return {"level": 2, "labels": labels, "finer": finer, "photo": "photo.png"}


def _sidecar() -> dict[str, Any]:
    return {
        "schema": SCHEMA, "name": "moss", "key": "0" * 16, "status": "ok", "reasons": ["dark"],
        "measures": {"seam": 1.0}, "files": [{"path": "a.exr", "bytes": 12, "sha256": "0" * 64}],
    }  # fmt: skip


def _live() -> dict[str, Any]:
    return {"oiiotex.live": 1, "source": "photo.png"} | default_state("d", "v", 256)


def _graph() -> dict[str, Any]:
    return {
        "exemplars": [{"id": "a", "file": "photo.png"}, {"id": "b", "file": "photo.png"}],
        "edges": [{"from": "a", "to": "b", "r": 2}, {"from": "b", "to": "b", "r": 1}],
    }


def _catalog(folder: Path) -> bytes:
    with Catalog(folder, create=True):
        pass
    with contextlib.closing(sqlite3.connect(folder / FILE)) as data:
        data.execute("PRAGMA wal_checkpoint(TRUNCATE)")
        data.execute("PRAGMA journal_mode=DELETE")
    return (folder / FILE).read_bytes()


def _archive(folder: Path) -> bytes:
    with zipfile.ZipFile(folder / "m.zip", "w", zipfile.ZIP_DEFLATED) as archive:
        for name in ("rock_diff.png", "rock_normal.png", "rock_rough.png"):
            archive.writestr(name, bytes(300))
    return (folder / "m.zip").read_bytes()


def _mesh(suffix: str, folder: Path) -> bytes:
    import trimesh

    box = trimesh.creation.box()
    if suffix in ("obj", "glb"):
        uv = box.vertices[:, :2] * 0.9 + 0.5
        box.visual = trimesh.visual.TextureVisuals(uv=uv)
    box.export(folder / f"whole.{suffix}")
    return (folder / f"whole.{suffix}").read_bytes()


def _labeled(folder: Path) -> bytes:
    """A label map whose header holds the names of its labels, as JSON."""
    spec = oiio.ImageSpec(16, 12, 1, oiio.UINT32)
    spec.attribute("oiio:subimagename", "label.1")
    spec.attribute("oiiotex:names", json.dumps(["moss", "stone"]))
    spec.attribute("compression", "none")
    buffer = oiio.ImageBuf(spec)
    buffer.set_pixels(buffer.roi, np.ones((12, 16, 1), np.uint32))
    assert buffer.write(str(folder / "l.exr")), buffer.geterror()
    return (folder / "l.exr").read_bytes()


def _piece(folder: Path) -> bytes:
    Checkpoint(folder / "out").piece("0" * 32, Window(0, 0, 4, 3), lambda: np.arange(12))
    (file,) = (folder / "out.parts").iterdir()
    return file.read_bytes()


def _arrays(folder: Path) -> bytes:
    cached_arrays(folder / "cache", "a", lambda: (np.arange(12), np.ones((2, 3))))
    (file,) = (folder / "cache").iterdir()
    return file.read_bytes()


# --- readers ---


def _read_recipe(path: Path) -> None:
    require_lines(load_recipe(path))


def _read_texture(path: Path) -> None:
    read_texture_file(str(path))
    read_texture_file(f"{path}?seed=3&level=1")


def _read_live(path: Path) -> None:
    Document(path, default_state("d", "v", 256), "photo.png", VIEWS)


def _read_sidecar(path: Path) -> None:
    path.rename(path.with_name(SIDECAR))
    sidecar = read_sidecar(path.parent)
    faults(path.parent, sidecar["files"])


def _read_catalog(path: Path) -> None:
    library = path.parent / "library"
    shutil.rmtree(library, ignore_errors=True)
    library.mkdir()
    path.rename(library / FILE)
    with Catalog(library) as catalog:
        for name in catalog.assets():
            catalog.asset(name), catalog.files(name)
        catalog.measures(), catalog.tags(), catalog.labels(), catalog.sources(), catalog.faults()


def _read_archive(path: Path) -> None:
    photos = path.parent / "photos"
    shutil.rmtree(photos, ignore_errors=True)
    photos.mkdir()
    path.rename(photos / "rock.zip")
    for material in materials(photos, _plain_recipe()):
        for file in material.maps.values():
            extract(photos, file, path.parent / "extracted")
    assert {entry.name for entry in path.parent.parent.iterdir()} == {path.parent.name}


@functools.cache
def _plain_recipe() -> Any:
    import tomllib

    return recipe_of(tomllib.loads(commented_recipe()), "recipe")


def _read_line(words: str, path: Path) -> None:
    run(["-q", *(word.replace("IN", path.name) for word in words.split())], path.parent)


def _read_piece(path: Path) -> None:
    place = Window(0, 0, 4, 3)
    checkpoint = Checkpoint(path.parent / "out")
    checkpoint.folder.mkdir(exist_ok=True)
    path.rename(checkpoint.folder / f"{'0' * 32}.{place}.piece")
    assert (checkpoint.piece("0" * 32, place, lambda: np.arange(12)) == np.arange(12)).all()


def _read_arrays(path: Path) -> None:
    (path.parent / "cache").mkdir(exist_ok=True)
    path.rename(path.parent / "cache" / "a.arrays")
    first, second = cached_arrays(path.parent / "cache", "a", lambda: (np.arange(12), np.ones((2, 3))))
    assert (first == np.arange(12)).all() and (second == 1).all()


COLORS = """ocio_profile_version: 2
roles: {default: raw, scene_linear: lin}
file_rules: [!<Rule> {name: Default, colorspace: default}]
displays: {d: [!<View> {name: v, colorspace: raw}]}
colorspaces:
  - !<ColorSpace> {name: raw, isdata: true}
  - !<ColorSpace> {name: lin, from_scene_reference: !<MatrixTransform> {matrix: [2,0,0,0, 0,2,0,0, 0,0,2,0, 0,0,0,1]}}
"""
FACTS = 'license = "CC0"\nauthor = "me"\ntags = ["green"]\nsize_m = [2, 2]\n'
WALL = {"oiiotex": 1, "photo": "photo.png", "size": "1000x700", "seed": 3}
KINDS = (
    Kind("recipe.toml", lambda _: commented_recipe().encode(), _read_recipe),
    Kind("facts.toml", lambda _: FACTS.encode(), facts_beside),
    Kind("wall.oiiotex", lambda _: WALL, _read_texture),
    Kind("a.texlive.json", lambda _: _live(), _read_live),
    Kind("names.json", lambda _: _names(), LabelNames),
    Kind("graph.json", lambda _: _graph(), read_graph),
    Kind("asset.json", lambda _: _sidecar(), _read_sidecar),
    Kind("library.sqlite", _catalog, _read_catalog),
    Kind("rock.zip", _archive, _read_archive),
    *(
        Kind(f"mesh.{suffix}", functools.partial(_mesh, suffix), lambda path: read_mesh(path, 32, 32))
        for suffix in ("obj", "ply", "glb", "stl", "off")
    ),
    Kind("labels.exr", _labeled, functools.partial(_read_line, "IN --texlabelview -o o.png")),
    Kind("colors.ocio", lambda _: COLORS.encode(),
         functools.partial(_read_line, "--colorconfig IN photo.png --colorconvert raw lin -o o.exr")),
    Kind("x.piece", _piece, _read_piece),
    Kind("x.arrays", _arrays, _read_arrays),
)  # fmt: skip


# --- cases ---


def _retold(document: Any, dice: random.Random) -> bytes:
    """JSON of the document with some values replaced, left out or told twice."""
    document = copy.deepcopy(document)
    for _ in range(dice.choice((1, 1, 2, 4))):
        at, key = document, None
        while isinstance(at, (dict, list)) and at and (key is None or dice.random() < 0.7):
            below = dice.choice(list(at) if isinstance(at, dict) else range(len(at)))
            if key is not None and not isinstance(at[below], (dict, list)) and dice.random() < 0.2:
                break
            last, key, at = at, below, at[below]
        if key is None:
            return json.dumps(dice.choice(_ODD)).encode()
        kind = dice.random()
        if kind < 0.75:
            last[key] = copy.deepcopy(dice.choice(_ODD))
        elif kind < 0.9:
            del last[key]
        elif isinstance(last, dict):
            last[dice.choice(("x", "", "id", key + " ", "\u00e9"))] = last.pop(key)
        else:
            last.append(last[key])
    return json.dumps(document).encode()


def case(kind: Kind, number: int, whole: Any) -> bytes:
    """The broken document of that number."""
    if isinstance(whole, bytes):
        return fuzz.broken(whole, number)
    dice = random.Random(number)
    return _retold(whole, dice) if dice.random() < 0.7 else fuzz.broken(json.dumps(whole).encode(), number)


def read(kind: Kind, number: int, folder: Path, whole: Any) -> None:
    """Read the broken document of that number in an empty folder: it is taken, or refused in one line.

    Raises
    ------
    AssertionError
        That does not hold; and what else readers should not raise.
    """
    inside = folder / "inside"
    shutil.rmtree(inside, ignore_errors=True)
    inside.mkdir(parents=True)
    save(np.zeros((8, 8, 3)), inside / "photo.png")
    path = inside / kind.name
    path.write_bytes(case(kind, number, whole))
    try:
        kind.read(path)
    except Error as error:
        assert str(error) and str(error).isprintable(), repr(str(error))


def _stop(*_: object) -> None:
    raise TimeoutError


def _child(name: str, numbers: range, folder: Path) -> None:
    """Cases in this process; what fails is printed."""
    resource.setrlimit(resource.RLIMIT_AS, (_BYTES, _BYTES))
    signal.signal(signal.SIGALRM, _stop)
    (kind,) = (one for one in KINDS if one.name == name)
    whole = kind.whole(folder)
    for number in numbers:
        (folder / "number").write_text(str(number))
        signal.alarm(_SECONDS)
        try:
            read(kind, number, folder / "case", whole)
        except Exception as error:
            at = traceback.extract_tb(error.__traceback__)[-1]
            print(ascii(f"{name} {number}: {type(error).__name__} {error} at {at.filename}:{at.lineno}")[1:-1][:900])
        signal.alarm(0)


def faults_of(kind: Kind, numbers: range) -> list[str]:
    """Read the cases of those numbers in a process that may die: what went wrong."""
    told = []
    with tempfile.TemporaryDirectory() as folder:
        begin = numbers.start
        while begin < numbers.stop:
            line = [sys.executable, "-m", "tests.fuzz_documents", "0", "--child", folder, "--kind", kind.name,
                    "--begin", str(begin), "--end", str(numbers.stop)]  # fmt: skip
            done = subprocess.run(line, capture_output=True, text=True, errors="replace", timeout=900)
            told += done.stdout.splitlines()
            if done.returncode == 0:
                break
            begin = int(Path(folder, "number").read_text())
            told.append(f"{kind.name} {begin}: the process ended with {done.returncode}: {done.stderr[-300:]}")
            begin += 1
    return told


def main() -> None:
    """Read as many broken documents as are asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("count", type=int, help="of all kinds together")
    parser.add_argument("--begin", type=int, default=0, help="the first number of every kind")
    parser.add_argument("--end", type=int)
    parser.add_argument("--kind", choices=[kind.name for kind in KINDS])
    parser.add_argument("--child", type=Path)
    given = parser.parse_args()
    if given.child:
        _child(given.kind, range(given.begin, given.end), given.child)
        return
    kinds = [kind for kind in KINDS if given.kind in (None, kind.name)]
    each = -(-given.count // len(kinds))
    for kind in kinds:
        told = [one for first in range(given.begin, given.begin + each, _CHUNK)
                for one in faults_of(kind, range(first, min(first + _CHUNK, given.begin + each)))]  # fmt: skip
        print("\n".join([f"{kind.name}: {each} read, {len(told)} wrong", *told]), flush=True)


if __name__ == "__main__":
    main()
