# SPDX-License-Identifier: Apache-2.0
"""What is done with a library: searched, shown, exported, reported."""

from __future__ import annotations

import contextlib
import json
import re
import shutil
import sqlite3
import subprocess

import pytest
from oiiotex_studio.library import catalog as catalogs
from oiiotex_studio.library.catalog import Catalog
from oiiotex_studio.library.commands import run
from oiiotex_studio.library.export import _blender_text, _require_distinct
from oiiotex_studio.library.report import write_report
from oiiotex_studio.library.search import AssetSearch
from oiiotex_studio.library.upkeep import check, orphans

from oiiotex.engine import errors
from oiiotex.engine.errors import ParameterError
from tests.browser import chromium
from tests.conftest import load
from tests.library_makings import LINE, brought_in, recipe
from tests.library_makings import here as here
from tests.library_makings import photos as photos


def test_nothing_is_exported_into_the_library(photos, tmp_path, here):
    library = tmp_path / "library"
    brought_in(photos, library, recipe())
    for target in (library, library / "assets", tmp_path / "photos/../library/new"):
        with pytest.raises(errors.Error, match="is inside the library: expected a folder outside of it"):
            run(["export", str(library), str(target)])
    with Catalog(library) as catalog:
        assert list(check(catalog)) == [] and orphans(catalog) == []


@pytest.mark.parametrize("names", [("brick", "Brick"), ("caf\u00e9", "cafe\u0301")])
def test_names_that_are_one_on_some_disks_are_not_exported_together(names):
    with pytest.raises(errors.ParameterError, match=r"have one name on many disks.*--name"):
        _require_distinct(["moss", *names])
    _require_distinct(["moss", "moss_2", names[0]])


def test_an_export_replaces_assets_alone(photos, tmp_path, here):
    library, target = tmp_path / "library", tmp_path / "target"
    brought_in(photos, library, recipe())
    (target / "wall").mkdir(parents=True)
    (target / "wall/mine.txt").write_text("mine")
    for sidecar in (None, "[]", '{"schema": "mine/1"}'):
        if sidecar:
            (target / "wall/asset.json").write_text(sidecar)
        with pytest.raises(errors.Error, match="is not an asset and would be overwritten; remove or rename it"):
            run(["export", str(library), str(target)])
    assert (target / "wall/mine.txt").read_text() == "mine" and not (target / "gravel").exists()
    (target / "wall/asset.json").write_text('{"schema": "oiiotex.asset/0"}')
    run(["export", str(library), str(target)])
    assert (target / "wall/wall.mtlx").is_file() and not (target / "wall/mine.txt").exists()


@pytest.mark.parametrize("name", ["index.json", "blender_assets.cats.txt"])
def test_an_export_replaces_no_list_of_others(photos, tmp_path, here, name):
    library, target = tmp_path / "library", tmp_path / "target"
    brought_in(photos, library, recipe())
    target.mkdir()
    (target / name).write_text('{"mine": 1}')
    with pytest.raises(errors.Error, match=rf"{name} is not .* would be overwritten; remove or rename it"):
        run(["export", str(library), str(target)])
    assert [path.name for path in target.iterdir()] == [name] and (target / name).read_text() == '{"mine": 1}'
    (target / name).unlink()
    for _ in range(2):  # its own it replaces
        run(["export", str(library), str(target)])
    assert json.loads((target / "index.json").read_text())["assets"] == ["gravel", "wall"]


def test_ingest_says_before_work_that_it_would_replace_a_file(photos, tmp_path):
    (tmp_path / "recipe.toml").write_text("schema = 1\n" + LINE)
    (tmp_path / "library").mkdir()
    (tmp_path / "library/blender_assets.cats.txt").write_text("mine")
    with pytest.raises(errors.Error, match="is not a list of Blender's catalogs"):
        run(["ingest", str(photos), str(tmp_path / "library"), "--recipe", str(tmp_path / "recipe.toml")])
    assert len(list((tmp_path / "library").iterdir())) == 1


def test_search_show_and_export(photos, tmp_path, here, capsys):
    library = tmp_path / "library"
    told = recipe('[assets.wall]\ntags = ["brick"]\nlicense = "CC0-1.0"\n' + LINE)
    brought_in(photos, library, told)
    with Catalog(library) as catalog:
        lab = catalog.assets()["wall"].lab

        def names(**terms: object) -> list[str]:
            return [asset.name for asset, _ in AssetSearch(**terms).assets(catalog)]

        assert names() == ["gravel", "wall"]
        assert names(tag="brick") == names(name="w*") == names(measures=("normal_length<0.5",)) == ["wall"]
        assert names(measures=("normal_length>0.5",)) == names(status="review") == names(size=">25x24") == []
        assert names(size="24x24") == names(size="<24x24") == ["gravel", "wall"]
        with pytest.raises(ParameterError, match=r"--measure nope: expected one of .*normal_length"):
            names(measures=("nope<6",))
        code = load(library / catalog.assets()["wall"].folder / "thumbnail.jpg").mean((0, 1)).round().astype(int)
        near = names(color="#" + "".join(f"{v:02x}" for v in code), distance=200.0)
        assert near == ["wall", "gravel"] and 0 < lab[0] < 100
        with pytest.raises(errors.Error, match="--color red"):
            names(color="red")
    assert run(["show", str(library), "wall"]) == 0
    assert json.loads(capsys.readouterr().out)["license"] == "CC0-1.0"
    out = tmp_path / "out"
    assert run(["export", str(library), str(out), "--tag", "brick"]) == 0
    assert sorted(p.name for p in out.iterdir()) == ["blender_assets.cats.txt", "index.json", "wall"]
    assert "Materials/brick" in (out / "blender_assets.cats.txt").read_text()
    assert run(["export", str(library), str(out), "--tag", "brick"]) == 0
    assert "0 copied, 1 unchanged" in capsys.readouterr().out
    with Catalog(library) as catalog:
        catalog.put(catalogs.Asset("unmade", "k", "failed"))
    with pytest.raises(errors.Error, match="no matching assets to export"):  # it has no folder
        run(["export", str(library), str(out), "--status", "failed"])
    (tmp_path / "file").touch()
    with pytest.raises(errors.Error, match=r"file: File exists$"):
        run(["export", str(library), str(tmp_path / "file"), "--tag", "brick"])
    assert run(["list", str(library), "--tag", "brick"]) == 0
    assert capsys.readouterr().out.startswith("wall ok 24x24")


@pytest.mark.parametrize("value", ["[", "[" * 100_000, "{}}", 7, b"\xff\xfe", '["\\ud800"]'])
def test_a_catalog_with_damaged_values_is_an_error(tmp_path, value):
    with Catalog(tmp_path, create=True) as catalog:
        catalog.put(catalogs.Asset("wall", "k", "ok"))
    with contextlib.closing(sqlite3.connect(tmp_path / catalogs.FILE)) as data:
        data.execute("UPDATE assets SET reasons = ?", (value,))
        data.commit()
    with pytest.raises(errors.Error, match=r"library\.sqlite: asset 'wall': .*: expected lists"):
        run(["list", str(tmp_path)])


def test_a_tag_is_one_catalog_of_blender(tmp_path):
    with Catalog(tmp_path, create=True) as catalog:
        catalog.put(catalogs.Asset("wall", "k", "ok"), tags=("a\nVERSION 2\n00000000-0000-0000-0000-000000000000:b:c",))
        (line,) = _blender_text(catalog, tmp_path / "none").splitlines()[4:]
    assert re.fullmatch(r"[0-9a-f-]{36}:Materials/a VERSION 2 0{8}-0000-0000-0000-0{12}-b-c:[^:]*", line)


def labeled(n: int, name: str, share: float, lab: tuple[float, ...], size_m: tuple[float, ...] = ()) -> tuple:
    asset = catalogs.Asset(f"m{n}", "k", "ok", width=64, height=64, size_m=size_m)
    rest = catalogs.AssetLabel("label.2/2", 0.9 - share, (90.0, 0.0, 0.0))
    return asset, (), {"labels": 2}, (), (catalogs.AssetLabel(name, share, lab), rest)


def test_labels_and_meters_are_searched(tmp_path):
    rust = (40.0, 35.0, 40.0)
    rows = [
        labeled(0, "rust", 0.1, rust, (1.0, 1.0)), labeled(1, "rust", 0.4, rust, (2.0, 3.0)),
        labeled(2, "moss", 0.3, (45.0, -20.0, 35.0)),
    ]  # fmt: skip
    with Catalog(tmp_path, create=True) as catalog:
        catalog.put_all(rows)
        assert catalog.labels()["m2"][0] == ("moss", 0.3, (45.0, -20.0, 35.0))

        def names(**terms: object) -> list[str]:
            return [asset.name for asset, _ in AssetSearch(**terms).assets(catalog)]

        assert names(label="rust") == ["m1", "m0"]  # the most first
        assert names(label="r*>0.2") == ["m1"] and names(label="rust>0.5") == names(label="bark") == []
        assert names(label="#9c3d20") == names(label="#9c3d20>0.05") == ["m1", "m0"]
        assert names(label="label.2/*>0.65") == ["m0"] and names(measures=("labels>1",)) == ["m0", "m1", "m2"]
        for wrong in ("rust>20%", "#9c3d20>x", ">0.2", "rust>1"):
            with pytest.raises(
                errors.Error, match=r"--label .*: expected NAME or #RRGGBB, optionally followed by >SHARE"
            ):
                names(label=wrong)
        for wrong in (-1.0, float("nan")):
            with pytest.raises(errors.Error, match=r"--distance .*: expected a number >= 0"):
                names(color="9c3d20", distance=wrong)
        assert names(size=">1.5x1.5m") == ["m1"] and names(size="1x1m") == ["m0"] and names(size="<2x2m") == ["m0"]
        for term in ("#rust", "rust>1"):
            with pytest.raises(errors.Error, match=f"--label {term}: expected"):
                names(label=term)
        catalog.put(rows[0][0])
        assert names(label="rust") == ["m1"]


def test_the_report_is_one_page_that_asks_for_nothing(photos, tmp_path, here):
    library = tmp_path / "library"
    (photos / "a<b_diff.png").write_bytes(b"")
    brought_in(photos, library, recipe(LINE + "[judge]\nlimits = ['normal_length<1']\n"))
    with Catalog(library) as catalog:
        page = write_report(catalog, "t & co").read_text()
    assert "t &amp; co" in page and "a_b" in page and page.count("<tr><td") == 3
    assert not re.search(r'(src|href)="(?!data:|review/|assets/)', page) and "http" not in page
    assert page.index(">failed<") < page.index(">review<") < page.index(">ok<")


@pytest.mark.slow
def test_the_reports_columns_sort_in_a_browser(tmp_path):
    browser = shutil.which("chromium") or pytest.skip("NOT RUN: no chromium")
    with Catalog(tmp_path, create=True) as catalog:
        for name, seam in (("a", 1.2), ("b", None), ("c", 0.9), ("d", 10.5)):
            measures = {} if seam is None else {"seam": seam}
            catalog.put(catalogs.Asset(name, "k", "ok"), (), measures)
        page = write_report(catalog, "sorted").read_text()
    for clicks, order in ((1, "cadb"), (2, "dacb")):
        click = "<script>" + "heads.find(h=>h.textContent==='seam').click();" * clicks + "</script>"
        (tmp_path / "clicked.html").write_text(page.replace("</html>", f"{click}</html>"))
        flags = ["--headless", "--no-sandbox", "--disable-gpu", "--disable-background-networking"]
        command = [browser, *flags, f"--user-data-dir={tmp_path}/profile", "--dump-dom"]
        done = subprocess.run(
            [*command, (tmp_path / "clicked.html").as_uri()], capture_output=True, text=True, timeout=100
        )
        assert "".join(re.findall(r'<tr><td data-v="(\w)"', done.stdout)) == order


@pytest.mark.parametrize("width", [800, 1280, 1920])
def test_the_reports_heads_stand_over_their_columns(tmp_path, width):
    with Catalog(tmp_path, create=True) as catalog:
        reasons = ("repeat>3: 3.42; " * 4).strip()
        for name in ("a", "mossy_rock_with_a_long_name"):
            catalog.put(catalogs.Asset(name, "k", "review", "", (reasons,)), (), {"seam": 1.2, "repeat": 3.42})
        page_file = write_report(catalog, "aligned")
    with chromium() as browser:
        page = browser.new_page(viewport={"width": width, "height": 700})
        page.goto(page_file.as_uri())
        sides = """row => [...row.cells].map(cell => {
          const box = cell.getBoundingClientRect();
          return [box.left, box.right, getComputedStyle(cell).textAlign];
        })"""
        head, *rows = (row.evaluate(sides) for row in page.query_selector_all("tr"))
    assert rows == [head, head]
