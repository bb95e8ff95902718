# SPDX-License-Identifier: Apache-2.0
"""Names from documents are no paths: what a run does not own is not created, changed, removed or copied."""

from __future__ import annotations

import ast
import contextlib
import os
import sqlite3
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("starlette", reason="NOT RUN: no starlette (pip install oiiotex-studio)")

from oiiotex_studio.library.catalog import FILE, Catalog
from oiiotex_studio.library.commands import run
from oiiotex_studio.library.report import write_report
from oiiotex_studio.library.runs import WORK

from oiiotex.engine.errors import Error, ParameterError
from oiiotex.engine.io.owned import checked_name, copy_folder, owned, remove_folder
from tests import fuzz_names
from tests.fuzz_names import SECRET, World, working

links = pytest.mark.skipif(os.name != "posix", reason="links need no privilege on POSIX")
PLAIN = ("moss", "Moos grün.v2", "苔", "a-b_c (2)", "v1.2.3", "<b>", "it's", "x" * 200, "~", "lock", "$HOME")
HOSTILE = (
    "../../../precious", "/etc/passwd", "a/b", "a\\b", "C:x", "C:\\x", ".", "..", "", " ", " a", "a ", ".hidden", "a.",
    "a\nb", "a\0b", "\x1b[2J", "\u202egnp", "\ud800", "x" * 201, "\u00e4" * 101,
)  # fmt: skip


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A canary tree with a library in it, made once."""
    return World(tmp_path_factory.mktemp("names"))


@pytest.fixture
def world(whole, monkeypatch):
    monkeypatch.chdir(whole.given / "here")
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(whole.given / "case"))
    whole.renew()
    with working():
        yield whole
    whole.require_untouched()


@pytest.mark.parametrize("name", PLAIN)
def test_names_that_people_have_are_taken(name):
    assert checked_name(name, "asset") == name


@pytest.mark.parametrize("name", HOSTILE, ids=ascii)
def test_a_name_is_no_path(name):
    with pytest.raises(ParameterError, match=r"^asset .*expected a printable name of at most 200 bytes") as caught:
        checked_name(name, "asset")
    assert str(caught.value).isprintable()


@links
def test_only_what_lies_in_the_owners_folder_is_removed_or_copied(tmp_path):
    own, other = tmp_path / "own", tmp_path / "other"
    for folder in (own / "a", other / "b"):
        folder.mkdir(parents=True)
        (folder / "file").write_text("kept")
    (own / "link").symlink_to(other)
    (own / "a/inner").symlink_to(other)
    (tmp_path / "alias").symlink_to(own)
    for path in (own, other, own / "../other", own / "a/../../other", own / "link", own / "link/b", own / "a\0"):
        for act in (owned, remove_folder, lambda path, owner: copy_folder(path, owner, tmp_path / "copy")):
            with pytest.raises(Error, match=r"is outside of|is a link, or below one: expected .*; remove the link"):
                act(path, own)
    with pytest.raises(Error, match=r"a/inner is a link or a device: expected files and folders; remove it"):
        copy_folder(own / "a", own, tmp_path / "copy")
    assert not (tmp_path / "copy").exists() and (other / "b/file").read_text() == "kept"
    remove_folder(own / "a", tmp_path / "own")  # the link in it is removed, not followed
    assert not (own / "a").exists() and (other / "b/file").exists()
    (own / "c").mkdir()
    copy_folder(tmp_path / "alias/c", tmp_path / "alias", tmp_path / "copy")  # the owner's folder may be a link
    remove_folder(tmp_path / "alias/c", tmp_path / "alias")
    remove_folder(own / "missing", own)
    assert (tmp_path / "copy").is_dir() and not (own / "c").exists()


def test_folders_are_removed_and_copied_in_one_place():
    root = Path(fuzz_names.__file__).parents[1]
    for path in (path for place in ("oiiotex", "studio") for path in (root / place).rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text())):
            name = node.attr if isinstance(node, ast.Attribute) else node.name if isinstance(node, ast.alias) else ""
            assert name not in ("rmtree", "copytree", "move", "removedirs") or path.name == "owned.py", path


@pytest.mark.parametrize("name", ["../../../precious", "../../../../precious", "ABSOLUTE", ".", "..", "", "a\nb"])
def test_a_recipe_names_no_folder_outside(world, name):
    name = str(world.precious) if name == "ABSOLUTE" else name
    recipe = {**fuzz_names._RECIPE, "assets": {name: {"maps": {"color": "moss.png"}}}}
    with pytest.raises(ParameterError, match=r"recipe: assets: .*expected a printable name"):
        world.ingest(recipe)


def test_a_catalog_of_others_names_no_folder_outside(world):
    library, out = world.given / "library", world.given / "out"
    for column in ("name", "folder"):
        for name in ("../../precious", "../precious", str(world.precious), "assets/../../precious", "..", "a\nb"):
            world.renew()
            with contextlib.closing(sqlite3.connect(library / FILE)) as data:
                data.execute(f"UPDATE assets SET {column} = ? WHERE name = 'moss'", (name,))
                data.commit()
            for words in (["list"], ["check"], ["gc"], ["export", str(out)]):
                with pytest.raises(Error, match=r"library\.sqlite: asset .*: expected a printable name"):
                    run([words[0], str(library), *words[1:]])
            assert not out.exists()


@links
def test_links_in_a_library_of_others_are_not_followed(world):
    library, out = world.given / "library", str(world.given / "out")
    (asset,) = (path.relative_to(library) for path in library.glob("assets/moss/*"))
    for place, target, words in (
        (asset / "notes.txt", "diary.txt", ["export", out]), (asset / "notes", "", ["export", out]),
        (asset / "asset.json", "asset.json", ["show", "moss"]), (asset, "moss/k", ["export", out]),
        ("review/moss", "moss", ["gc"]), ("review", "", ["gc"]), (f"{WORK}/run-0", "", ["gc"]),
        (f"{WORK}/lock", "diary.txt", ["gc"]), (f"{WORK}/run-0/lock", "diary.txt", ["gc"]), (WORK, "", ["gc"]),
        (f"{WORK}/lock", "new", ["gc"]), (f"{WORK}/run-0/lock", "new", ["gc"]), ("ingest.log", "new", ["gc"]),
        ("report.html", "diary.txt", ["gc"]), ("ingest.log", "diary.txt", ["gc"]), (f"{FILE}-wal", "lock", ["list"]),
    ):  # fmt: skip
        world.renew()
        path = library / place
        path.parent.mkdir(parents=True, exist_ok=True)
        if path.exists():
            path.rename(world.given / "case" / "before")
        path.symlink_to(world.precious / target)
        with pytest.raises(Error, match="is a link"):
            run([words[0], str(library), *words[1:]])
        world.require_untouched()


@links
@pytest.mark.parametrize(
    ("place", "words", "told"),
    [
        ("asset.json", ["show", "moss"], "asset.json is a pipe"), ("asset.json", ["check"], "asset.json is a pipe"),
        ("moss.mtlx", ["check"], "moss.mtlx is a pipe"), ("moss.mtlx", ["export", "out"], "moss.mtlx is a link or a"),
        ("../../../ingest.log", ["gc"], "ingest.log is a pipe"), (f"../../../{WORK}/lock", ["gc"], "lock is a pipe"),
    ],
)  # fmt: skip
def test_pipes_in_a_library_of_others_are_not_opened(world, place, words, told):
    """Opening one would wait for its other end, for good."""
    world.renew()
    library = world.given / "library"
    (asset,) = library.glob("assets/moss/*")
    (asset / place).unlink(missing_ok=True)
    os.mkfifo(asset / place)
    line = [sys.executable, "-m", "oiiotex_studio.library.main", words[0], str(library), *words[1:]]
    done = subprocess.run(line, cwd=world.given, capture_output=True, text=True, timeout=120)
    assert told in done.stdout + done.stderr and done.returncode == 1, done


@links
def test_a_report_shows_no_files_from_outside_and_no_markup(world):
    library = world.given / "library"
    (card,) = library.glob("assets/moss/*/card.jpg")
    card.unlink()
    card.symlink_to(world.precious / "card.jpg")
    with contextlib.closing(sqlite3.connect(library / FILE)) as data:
        text = "<script>alert(1)</script>"
        data.execute("UPDATE assets SET width = ?, height = 1, author = ?, reasons = json_array(?)", (text,) * 3)
        data.execute("UPDATE measures SET value = ?", (text,))
        data.commit()
    with Catalog(library) as catalog:
        page = write_report(catalog, "<b>").read_text()
    assert "<script>alert" not in page and "<b>" not in page and page.count("<img") == 1  # of the other asset
    assert SECRET.decode() not in page


def test_a_member_of_an_archive_is_no_path(world):
    for number in range(3):
        for name in ("../../../precious", "..", "/etc", "x" * 300):
            world.renew()
            with contextlib.suppress(Error):
                fuzz_names._archive(world, name, fuzz_names.random.Random(number))
            world.require_untouched()


def test_hostile_names_in_all_documents(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    assert fuzz_names.faults_of(range(60), tmp_path) == []


@pytest.mark.slow
def test_hostile_names_in_200_documents(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    assert fuzz_names.faults_of(range(60, 200), tmp_path) == []
