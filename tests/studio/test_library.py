# SPDX-License-Identifier: Apache-2.0
"""A library from a folder: what is made by lines, delivered, and kept, also when photos and files are broken."""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import re
import shutil
import sqlite3
import zipfile

import numpy as np
import OpenImageIO as oiio
import pytest
from oiiotex_studio.library import digests, ingest, runs, steps
from oiiotex_studio.library.asset import read_sidecar
from oiiotex_studio.library.catalog import Catalog
from oiiotex_studio.library.commands import run
from oiiotex_studio.library.report import write_report
from oiiotex_studio.library.upkeep import check, orphans
from oiiotex_studio.recipes import found as finding

from oiiotex.engine import errors
from tests import pictures as drawn
from tests.conftest import load, save
from tests.library_makings import LINE, OPENGL, brought_in, bumps, recipe
from tests.library_makings import here as here
from tests.library_makings import photos as photos


def test_an_asset_holds_what_is_delivered(photos, tmp_path, here):
    library = tmp_path / "library"
    tally, said = brought_in(photos, library, recipe(LINE + "[deliver]\nusd = true\n"))
    assert (tally.made, tally.counts, tally.status) == (2, {"ok": 2}, 0)
    assert any(re.match(r"wall: ok, \d+ files, \d+\.\d MB, \d+\.\d s", line) for line in said)
    with Catalog(library) as catalog:
        wall = catalog.assets()["wall"]
        assert list(check(catalog)) == []
    folder = library / wall.folder
    assert wall.folder.startswith("assets/wall/")
    given = load(photos / "scans/wall_nor_gl_1k.png") / 255
    np.testing.assert_allclose(load(folder / "tile/normal.exr"), given, atol=1e-3)
    code = load(photos / "scans/wall_diff_1k.png") / 255
    linear = np.where(code <= 0.04045, code / 12.92, ((code + 0.055) / 1.055) ** 2.4)
    np.testing.assert_allclose(load(folder / "tile/color.exr"), linear, atol=2e-3)
    texture = oiio.ImageBuf(str(folder / "tx/roughness.tx"))
    assert (texture.nmiplevels, texture.spec().get_string_attribute("wrapmodes")) == (5, "periodic,periodic")
    sidecar = json.loads((folder / "asset.json").read_text())
    assert sidecar["schema"] == "oiiotex.asset/2" and sidecar["normals"] == "opengl"
    assert sidecar["lines"]["tile"].startswith("oiiotex source/color.png --iscolorspace srgb_rec709_scene ")
    assert {source["role"] for source in sidecar["sources"]} == {"color", "normal", "roughness"}
    assert not list((library / runs.WORK).glob("run-*"))
    for name in ("thumbnail", "preview_2x2", "lit", "card"):
        assert load(folder / f"{name}.jpg").std() > 2


def test_an_asset_says_its_lattice_its_meters_and_its_labels(tmp_path, here, capsys):
    (tmp_path / "photos").mkdir()
    cell = np.dstack([drawn.noise(16, 16, seed) for seed in range(3)])
    save(np.tile(cell, (4, 6, 1)), tmp_path / "photos/checks.png")
    told = """
[[product]]
name = "tile"
line = "$maps --texstationarize:kinds=$kinds:iterations=1:report=$report $outputs"
[[product]]
name = "labels"
line = "$color --texlabel:photo=1 -o $output"
[assets.checks]
size_m = [3.0, 2.0]
"""
    tally, said = brought_in(tmp_path / "photos", tmp_path / "library", recipe(told))
    assert tally.counts == {"ok": 1}, said
    (path,) = (tmp_path / "library").glob("assets/*/*/asset.json")
    sidecar = json.loads(path.read_text())
    steps = np.sort(np.abs(sidecar["lattice"]), axis=0)
    np.testing.assert_allclose(steps, [[0, 0], [16, 16]], atol=0.7)
    assert sidecar["tile_m"] == pytest.approx([sidecar["width"] / 32, sidecar["height"] / 32])
    np.testing.assert_allclose(sidecar["lattice_m"], np.array(sidecar["lattice"]) / 32)
    assert sidecar["measures"]["labels"] == len(sidecar["labels"]) >= 1
    assert sum(one["share"] for one in sidecar["labels"]) == pytest.approx(1, abs=0.01)
    name = sidecar["labels"][0]["name"]
    assert run(["list", str(tmp_path / "library"), "--label", name, "--size", ">1x1m"]) == 0
    assert capsys.readouterr().out.startswith("checks ")


def test_tiff_and_spaces_of_their_own(photos, tmp_path, here):
    told = recipe(LINE + '[deliver]\nformat = "tiff"\ncolor = ""\ntx = false\nmaterialx = false\n')
    brought_in(photos, tmp_path / "library", told)
    (path,) = (tmp_path / "library").glob("assets/wall/*/tile/color.tif")
    assert oiio.ImageBuf(str(path)).spec().format == oiio.UINT16
    np.testing.assert_array_equal(load(path), load(photos / "scans/wall_diff_1k.png").astype(np.uint16) * 257)


def test_packed_maps_and_archives_are_delivered_as_maps(tmp_path, here):
    folder = tmp_path / "photos"
    folder.mkdir()
    packed = np.dstack([drawn.noise(16, 16, n) for n in range(3)])
    with zipfile.ZipFile(folder / "pack.zip", "w") as archive:
        archive.write(save(drawn.bricks(16, 16, 2), tmp_path / "a.png"), "maps/f_diff_1k.png")
        archive.write(save(packed, tmp_path / "b.png"), "maps/f_arm_1k.png")
    tally, _ = brought_in(folder, tmp_path / "library", recipe())
    assert tally.counts == {"ok": 1}
    for channel, role in enumerate(("ao", "roughness", "metal")):
        (path,) = (tmp_path / "library").glob(f"assets/f/*/tile/{role}.exr")
        np.testing.assert_allclose(load(path)[..., 0], load(tmp_path / "b.png")[..., channel] / 255, atol=1e-3)


def test_normals_of_directx_are_turned_on_request(photos, tmp_path, here):
    (photos / "scans/wall_nor_gl_1k.png").rename(photos / "scans/wall_nor_dx_1k.png")
    given = load(photos / "scans/wall_nor_dx_1k.png") / 255
    brought_in(photos, tmp_path / "a", recipe())
    (path,) = (tmp_path / "a").glob("assets/wall/*/tile/normal.exr")
    np.testing.assert_allclose(load(path), given * [1, -1, 1] + [0, 1, 0], atol=1e-3)
    brought_in(photos, tmp_path / "b", recipe(LINE + '[deliver]\nnormals = ""\n'))
    (path,) = (tmp_path / "b").glob("assets/wall/*/tile/normal.exr")
    np.testing.assert_allclose(load(path), given, atol=1e-3)
    document = next(path.parents[1].glob("*.mtlx")).read_text()
    assert document.count('<multiply name="normal_turned"') == 1


def test_heights_displace_if_their_scale_is_known(photos, tmp_path, here):
    save(drawn.smooth_noise(24, 24, 6, 4)[..., None], photos / "scans/wall_height_1k.png")
    for told, count in (("", 0), ("height_m = 0.02\n", 1)):
        library = tmp_path / f"library{count}"
        brought_in(photos, library, recipe(f"[find]\n{told}{LINE}[deliver]\nusd = true\n"))
        (document,), (stage,) = library.glob("assets/wall/*/wall.mtlx"), library.glob("assets/wall/*/*.usda")
        own = document.read_text()
        assert own.count('<displacement name="displacement_wall" type="displacementshader">') == count
        assert own.count('name="scale" type="float" value="0.02"') == count
        assert stage.read_text().count("inputs:displacement.connect") == count
        assert stage.read_text().count("float4 inputs:scale = (0.02, 0.02, 0.02, 1)") == count
        with Catalog(library) as catalog:
            assert list(check(catalog)) == []


def test_normals_that_are_short_in_the_scan_are_no_fault_of_the_tile(photos, tmp_path, here):
    path = photos / "scans/wall_nor_gl_1k.png"
    save(0.5 + 0.7 * (load(path) / 255 - 0.5), path)  # of length 0.7
    (photos / "scans/wall_rough_1k.png").unlink()  # the normals are on top of the stack
    for line, low, high in ((LINE, 0, 0.01), (LINE.replace("$maps", "$maps --mulc 0.6"), 0.1, 1)):
        library = tmp_path / f"library{low}"
        brought_in(photos, library, recipe(line))
        with Catalog(library) as catalog:
            assert low <= catalog.measures()["wall"]["normal_length"] <= high


def test_normals_without_a_convention_are_measured_and_asked_for_if_they_do_not_tell(tmp_path, here):
    folder, library = tmp_path / "photos", tmp_path / "library"
    folder.mkdir()
    for name, normals in (("moss", bumps(48) * [1, -1, 1] + [0, 1, 0]), ("slab", np.full((48, 48, 3), [0.5, 0.5, 1]))):
        save(drawn.pebbles(48, 48, 1), folder / f"{name}_diff.png")
        save(normals, folder / f"{name}_nor.png")
    tally, said = brought_in(folder, library, recipe())
    assert tally.counts == {"ok": 1, "asked": 1} and tally.status == 3
    assert any(line.startswith("moss: ok") and ", normals DirectX " in line for line in said)
    assert any(line.startswith("slab: asked: which convention do the normals have?") for line in said)
    with Catalog(library) as catalog:
        asset = catalog.assets()["moss"]
        assert catalog.measures()["moss"]["convention"] < -0.5
        assert "DirectX " in write_report(catalog, "library").read_text()
    sidecar = read_sidecar(library / asset.folder)
    assert [source.get("normals") for source in sidecar["sources"]] == [None, "directx"]
    np.testing.assert_allclose(load(library / asset.folder / "tile/normal.exr"), bumps(48), atol=0.01)
    tally, said = brought_in(folder, library, recipe())
    assert (tally.made, tally.unchanged, said) == (0, 2, [])
    assert brought_in(folder, library, recipe(OPENGL.removeprefix("schema = 1\n") + LINE))[0].counts == {"ok": 2}


def test_a_second_run_makes_only_what_has_changed(photos, tmp_path, here, monkeypatch):
    library = tmp_path / "library"
    brought_in(photos, library, recipe())
    tally, said = brought_in(photos, library, recipe())
    assert (tally.made, tally.unchanged, said) == (0, 2, [])
    save(drawn.pebbles(24, 24, 9), photos / "gravel.png")
    tally, said = brought_in(photos, library, recipe())
    assert (tally.made, tally.unchanged) == (1, 1)
    assert said[0] == "1 to make (gravel), 1 unchanged" and said[1].startswith("gravel: ok")
    with Catalog(library) as catalog:
        assert len(orphans(catalog)) == 1
    lines = []
    work = steps.work
    monkeypatch.setattr(steps, "work", lambda job, watch: (lines.append(job), work(job, watch))[1])
    tally, _ = brought_in(photos, library, recipe(LINE + "[judge]\nlimits = ['normal_length>0.5']\n"))
    assert (tally.made, lines) == (2, [])  # judged anew, by the same pixels
    with Catalog(library) as catalog:
        assert list(check(catalog)) == []
    assert run(["gc", str(library)]) == 0
    with Catalog(library) as catalog:
        assert (orphans(catalog), list(check(catalog))) == ([], [])
    assert len(list(library.glob("assets/*/*"))) == 2


def test_an_asset_whose_folder_has_gone_is_made_again(photos, tmp_path, here):
    library = tmp_path / "library"
    brought_in(photos, library, recipe())
    (folder,) = library.glob("assets/gravel/*")
    shutil.rmtree(folder)
    tally, _ = brought_in(photos, library, recipe())
    assert (tally.made, tally.unchanged) == (1, 1) and folder.is_dir()
    with Catalog(library) as catalog:
        assert list(check(catalog)) == []


def test_a_broken_catalog_is_written_anew_from_the_folders(photos, tmp_path, here, monkeypatch):
    library = tmp_path / "library"
    brought_in(photos, library, recipe())
    (library / runs.FILE).write_bytes(b"no database" * 1000)
    with pytest.raises(
        errors.Error, match=r"library.sqlite: file is not a database; remove .*library.sqlite[*] and run ingest"
    ):
        run(["list", str(library)])
    (library / runs.FILE).unlink()
    monkeypatch.setattr(ingest, "_in_processes", lambda jobs, workers: [pytest.fail(f"{job}") for job in jobs])
    brought_in(photos, library, recipe())
    with Catalog(library) as catalog:
        assert list(catalog.assets()) == ["gravel", "wall"] and list(check(catalog)) == []


@pytest.mark.parametrize("damage", ["emptied", "no rows", "no table"])
def test_an_emptied_catalog_is_no_library_without_assets(photos, tmp_path, here, damage):
    library = tmp_path / "library"
    brought_in(photos, library, recipe())
    path = library / runs.FILE
    if damage == "emptied":
        path.write_bytes(b"")
    else:
        with contextlib.closing(sqlite3.connect(path)) as data, data:
            data.execute("PRAGMA foreign_keys=ON")
            data.execute("DELETE FROM assets" if damage == "no rows" else "DROP TABLE assets")
    says = ": no such table: assets; remove it and" if damage == "no table" else " is empty, but the library has assets"
    for command in ("list", "check", "gc"):
        with pytest.raises(errors.Error, match=f"{runs.FILE}{says}.* run ingest again"):
            run([command, str(library)])
    if damage == "no table":
        path.unlink()
    tally, _ = brought_in(photos, library, recipe())
    assert tally.counts == {"ok": 2} and run(["check", str(library)]) == 0


def test_an_asset_whose_row_is_lost_is_no_garbage(photos, tmp_path, here):
    library = tmp_path / "library"
    brought_in(photos, library, recipe())
    with contextlib.closing(sqlite3.connect(library / runs.FILE)) as data, data:
        data.execute("PRAGMA foreign_keys=ON")
        data.execute("DELETE FROM assets WHERE name = 'wall'")
    assert run(["gc", str(library)]) == 0
    assert list(library.glob("assets/wall/*/asset.json"))
    brought_in(photos, library, recipe())
    with Catalog(library) as catalog:
        assert list(catalog.assets()) == ["gravel", "wall"] and list(check(catalog)) == []


@pytest.mark.parametrize(
    "damage",
    [
        {"name": "../../gone"},
        {"labels": "x"},
        {"labels": [{"name": 5, "share": "nan?", "color_lab": [1, 2, 3]}]},
        {"measures": {"seam": "low"}},
        {"tags": 3},
        {"files": [{"path": "../../../../photos/gravel.png", "role": "tile", "bytes": 0, "sha256": ""}]},
    ],
)
def test_a_folder_that_says_what_is_no_asset_is_made_again(photos, tmp_path, here, damage):
    library = tmp_path / "library"
    brought_in(photos, library, recipe())
    (path,) = library.glob("assets/gravel/*/asset.json")
    if "files" in damage:
        photo = (photos / "gravel.png").read_bytes()
        damage["files"][0] |= {"bytes": len(photo), "sha256": hashlib.sha256(photo).hexdigest()}
        assert (path.parent / damage["files"][0]["path"]).is_file()
    path.write_text(json.dumps(json.loads(path.read_text()) | damage))
    (library / runs.FILE).unlink()
    tally, _ = brought_in(photos, library, recipe())
    assert tally.counts == {"ok": 2}
    with Catalog(library) as catalog:
        assert list(catalog.assets()) == ["gravel", "wall"] and list(check(catalog)) == []


def test_what_is_beyond_a_limit_waits_for_review(photos, tmp_path, here):
    save(drawn.noise(24, 24, 3)[..., None], photos / "scans" / "wall_disp_1k.png")
    told = recipe(LINE + "[judge]\nlimits = ['height_steps>0.1']\n")
    tally, said = brought_in(photos, tmp_path / "library", told)
    assert (tally.status, tally.counts) == (3, {"ok": 1, "review": 1})
    (folder,) = (tmp_path / "library").glob("review/wall/*")
    assert (folder / "reason.txt").read_text().startswith("height_steps>0.1: 0.")
    assert (folder / "card.jpg").is_file()


def test_a_photo_that_is_not_there_fails_alone(photos, tmp_path, here, monkeypatch):
    (photos / "linked_diff.png").symlink_to("nowhere.png")
    (photos / "gone_diff.png").touch()
    digest = digests.digest_of
    monkeypatch.setattr(digests, "digest_of", lambda p: (p.name == "gone_diff.png" and p.unlink(), digest(p))[1])
    tally, said = brought_in(photos, tmp_path / "library", recipe())
    assert (tally.status, tally.counts) == (1, {"failed": 2, "ok": 2})
    for name in ("gone", "linked"):
        assert f"{name}: failed: {name}_diff.png: cannot read: No such file or directory" in said
    with Catalog(tmp_path / "library") as catalog:
        assert catalog.assets()["linked"].status == "failed" and list(check(catalog)) == []


def test_a_photo_whose_name_is_no_text_fails_alone(photos, tmp_path, here, capsys):
    try:
        (photos / os.fsdecode(b"caf\xe9_diff.png")).touch()
        (photos / os.fsdecode(b"caf\xe9_x_col.png")).touch()
        (photos / os.fsdecode(b"caf\xe9_x_col.jpg")).touch()
    except OSError:
        pytest.skip("NOT RUN: file names are text here")
    library = tmp_path / "library"
    tally, said = brought_in(photos, library, recipe())
    assert (tally.status, tally.counts) == (1, {"failed": 1, "asked": 1, "ok": 2})
    assert r"caf: failed: caf\udce9_diff.png: the file name is not UTF-8; rename it" in said
    with Catalog(library) as catalog:
        write_report(catalog, "library")
    assert run(["list", str(library), "--status", "asked"]) == 0 and r"caf\udce9_x_col" in capsys.readouterr().out


@pytest.mark.parametrize("disk", ["of the library", "of its own"])
def test_no_line_gets_at_the_photos(photos, tmp_path, here, monkeypatch, disk):
    if disk == "of its own":
        monkeypatch.setattr(finding.os, "link", lambda *names: os.stat("/no link across disks"))
    before = (photos / "gravel.png").read_bytes()
    product = LINE + '[[product]]\nname = "u"\nline = "$color --dup --flip -o {BOTTOM.filename}"\n'
    tally, said = brought_in(photos, tmp_path / "library", recipe(product))
    assert tally.counts == {"failed": 2} and all("is not in the product's folder" in text for text in said[1:]), said
    tally, said = brought_in(photos, tmp_path / "library", recipe(product.replace("{BOTTOM.filename}", "u/x.png")))
    assert tally.counts == {"ok": 2}, said
    assert (photos / "gravel.png").read_bytes() == before


def test_a_broken_material_fails_alone(photos, tmp_path, here):
    (photos / "broken_diff.png").write_bytes(b"no picture")
    library = tmp_path / "library"
    tally, said = brought_in(photos, library, recipe())
    assert (tally.status, tally.counts) == (1, {"failed": 1, "ok": 2})
    assert any(line.startswith("broken: failed: product tile: ") for line in said)
    save(drawn.pebbles(24, 24, 3), photos / "broken_diff.png")
    tally, _ = brought_in(photos, library, recipe())
    assert (tally.made, tally.unchanged, tally.status) == (1, 2, 0)
    (photos / "gravel.png").write_bytes(b"no picture")
    brought_in(photos, library, recipe())
    run(["gc", str(library)])
    assert list(library.glob("assets/gravel/*/asset.json"))  # what was good is not lost with what failed


def test_a_material_of_one_name_in_two_folders_is_asked_for(photos, tmp_path, here):
    library = tmp_path / "library"
    brought_in(photos, library, recipe())
    other = tmp_path / "other"
    other.mkdir()
    save(drawn.pebbles(24, 24, 7), other / "gravel.png")
    tally, said = brought_in(other, library, recipe())
    assert tally.status == 3 and "also has a material of that name" in said[0]
    shutil.move(photos, tmp_path / "moved")
    tally, _ = brought_in(tmp_path / "moved", library, recipe())
    assert (tally.made, tally.status) == (0, 0)


def test_photos_and_library_are_two_folders(photos):
    with pytest.raises(errors.Error, match="photos and library are the same folder"):
        brought_in(photos, photos, recipe())


def test_a_folder_that_is_there_is_taken_if_it_is_whole(photos, tmp_path, here):
    library = tmp_path / "library"
    brought_in(photos, library, recipe())
    for suffix in ("", "-wal", "-shm"):
        (library / f"library.sqlite{suffix}").unlink(missing_ok=True)
    (spoiled,) = library.glob("assets/wall/*/tile/normal.exr")
    whole = next(library.glob("assets/gravel/*/asset.json"))
    before = whole.stat().st_mtime_ns
    spoiled.write_bytes(spoiled.read_bytes()[:-5])
    tally, _ = brought_in(photos, library, recipe())
    assert tally.counts == {"ok": 2} and whole.stat().st_mtime_ns == before
    with Catalog(library) as catalog:
        assert list(check(catalog)) == []


def test_check_finds_every_kind_of_damage(photos, tmp_path, here, capsys):
    library = tmp_path / "library"
    brought_in(photos, library, recipe())
    (folder,) = library.glob("assets/wall/*")
    spoiled = folder / "tx/color.tx"
    data = bytearray(spoiled.read_bytes())
    data[100] ^= 1
    spoiled.write_bytes(data)
    (folder / "tx/roughness.tx").unlink()
    assert run(["check", str(library)]) == 1
    text = capsys.readouterr().out
    assert "color.tx has changed since it was written" in text and "roughness.tx is missing" in text
    assert "wall.mtlx" in text and text.splitlines()[-1].startswith("2 assets, 4 errors")
