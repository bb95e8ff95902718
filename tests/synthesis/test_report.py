# SPDX-License-Identifier: Apache-2.0
"""report= and fail=: the measures of every op that synthesizes, for machines."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

from oiiotex import filters
from oiiotex.analysis.regularity.lattice import Lattice
from oiiotex.engine import errors
from oiiotex.engine.core.source_map import SourceMap
from oiiotex.engine.session import Session
from oiiotex.synthesis.exemplar import synthesis_run
from oiiotex.synthesis.quality import lost_structure, patch_texture, report
from oiiotex.synthesis.quality.report import SCHEMA
from oiiotex.synthesis.quality.report_measures import REPORT_MEASURES
from tests import pictures
from tests.any_filter import buffer, labeled, pixels, quarters
from tests.conftest import oiiotex, save
from tests.refusals import refused

pytestmark = pytest.mark.usefixtures("few_places")
ROOT = Path(__file__).parents[2]
PHOTO = pictures.stained(pictures.bricks(64, 72, seed=2))
QUICK = {"iterations": 3, "seed": 1}
COPIES = {"texture", "copied", "shown", "repeat"}
PAINTED = {"label", "label_shown", "label_repeat"}
ACROSS = {"seam", "seam_x", "seam_x_photo", "quieter_x", "salient"}
SEAMS = ACROSS | {"seam_y", "seam_y_photo", "quieter_y", "waves", "uneven"}
ALWAYS = {"cost", "cost_photo", "loss"}
LIKE = {"fidelity", "band_96", "band_48", "band_24", "shapes", "lines", "missing"}  # of what is to look like the photo
OF_TILES = LIKE | COPIES | {"broken"}
LOSSES = {"textured", "textured_photo", "regular", "regular_photo"}  # the photo is of bricks
MADE = {  # what is measured beside what always is, and how it is made
    "stationarize": (OF_TILES | SEAMS | LOSSES, lambda **more: filters.stationarize(buffer(PHOTO), **QUICK, **more)),
    "patchmatch": (OF_TILES | ACROSS, lambda **more: filters.patchmatch(buffer(PHOTO), **QUICK, tiles="x", **more)),
    "quilt": (OF_TILES | SEAMS, lambda **more: filters.quilt(buffer(PHOTO), size=(80, 64), tiles="xy", **more)),
    "cut": (OF_TILES | SEAMS, lambda **more: filters.cut(buffer(PHOTO), size=(60, 60), **more)),
    "composite": (COPIES, lambda **more: filters.composite(labeled(buffer(PHOTO)), size=(80, 72), patch=16, **more)),
    "paint": (COPIES | PAINTED, lambda **more: filters.paint(labeled(buffer(PHOTO)), quarters(), patch=16, **more)),
    "synth": (
        OF_TILES | SEAMS,
        lambda **more: filters.synth(buffer(PHOTO), size=(64, 64), tiles="xy", exemplarside=64, **more),
    ),
    "zoom": (LIKE, lambda **more: filters.zoom(buffer(PHOTO), size=(64, 48), exemplarside=64, **more)),
}


def measures(path: Path) -> dict[str, float]:
    document = json.loads(path.read_text())
    assert len(document["results"]) == 1
    return document["results"][0]["measures"]


def test_every_filter_that_synthesizes_reports():
    with_report = {op.name for op in filters.OURS if "report" in {p.name for p in op.parameters()}}
    copying = {op.name for op in filters.OURS if op.copies and "seed" in {p.name for p in op.parameters()}}
    assert with_report == {*MADE, "fill"}  # its measures are others: tests/synthesis/test_fill.py
    assert copying - with_report == {"atlas", "transition"}  # pieces with nothing between; two tiles


@pytest.mark.parametrize("name", MADE)
def test_a_report_holds_the_measures_of_the_result(name, tmp_path, monkeypatch):
    names, make = MADE[name]
    plain = make()
    result = make(report=tmp_path / "r.json")
    np.testing.assert_array_equal(pixels(plain), pixels(result))
    document = json.loads((tmp_path / "r.json").read_text(), parse_constant=lambda text: pytest.fail(text))
    assert (document["schema"], document["filter"], document["passed"], document["limits"]) == (SCHEMA, name, True, [])
    (entry,) = document["results"]
    spec = result.spec()
    assert (entry["width"], entry["height"]) == (spec.width, spec.height)
    assert set(entry["measures"]) == ALWAYS | names
    assert set(entry["measures"]) <= set(REPORT_MEASURES)
    assert all(np.isfinite(value) for value in entry["measures"].values())
    if name in ("stationarize", "paint", "zoom"):  # the others hold their maps in the same way
        monkeypatch.setattr(report, "_HELD_SHARE", 0)  # rows lie in files
        make(report=tmp_path / "filed.json")
        assert measures(tmp_path / "filed.json") == entry["measures"]


def test_a_small_budget_measures_384_px_with_the_same_numbers(tmp_path, caplog):
    """Once it took 200 bytes a pixel of photo and result, 59 MB."""
    caplog.set_level("INFO", "oiiotex")
    photo, values = (
        buffer(pictures.bricks(384, 384, seed=2)),
        {"patch": 32, "tiles": "xy", "lattice": 0, "flattening": 0},
    )
    filters.quilt(photo, report=tmp_path / "a.json", **values)
    filters.quilt(photo, report=tmp_path / "b.json", session=Session(budget=40 << 20, measure=True), **values)
    assert measures(tmp_path / "a.json") == measures(tmp_path / "b.json")
    assert "--texquilt: stationarity cost" in caplog.text


def test_a_large_image_is_matched_in_windows(tmp_path, monkeypatch):
    photo = buffer(pictures.pebbles(96, 96, seed=1))
    filters.quilt(photo, size=(256, 256), report=tmp_path / "whole.json")
    monkeypatch.setattr(patch_texture, "WHOLE", 1 << 14)
    filters.quilt(photo, size=(256, 256), report=tmp_path / "windows.json")
    whole, windows = measures(tmp_path / "whole.json"), measures(tmp_path / "windows.json")
    assert windows.pop("texture") == pytest.approx(whole.pop("texture"), rel=0.2) and windows == whole


def test_regularity_of_a_large_image_is_that_of_its_middle(monkeypatch):
    values = np.add.outer(np.sin(np.arange(600) / 2), np.cos(np.arange(500) / 3))[..., None].repeat(3, 2)
    lattice = Lattice(np.array([[0.5, 0], [0, 1 / 3]]) / np.pi / 2 @ [[0, 1], [1, 0]], 1.0, np.zeros((8, 8)))
    places = SourceMap.of(np.arange(600)[:, None], np.arange(500)[None, :])
    whole = lost_structure._regularity(places, values, lattice, False)
    monkeypatch.setattr(lost_structure, "_SIDE", 300)
    assert lost_structure._regularity(places, values, lattice, False) == pytest.approx(whole, abs=0.05)
    monkeypatch.setattr(lost_structure, "_SIDE", 90)  # every second pixel of what four steps take
    assert lost_structure._regularity(places, values, lattice, False) == pytest.approx(whole, abs=0.1)


def test_measures_are_what_v_says(tmp_path, caplog):
    caplog.set_level("INFO", "oiiotex")
    filters.stationarize(buffer(PHOTO), **QUICK, report=tmp_path / "r.json", session=Session(measure=True))
    found, text = measures(tmp_path / "r.json"), caplog.text
    assert f"texture cost {found['texture']:.2f} Lab^2" in text
    assert f"seam ratio x {found['seam_x_photo']:.2f} -> {found['seam_x']:.2f}" in text
    assert f"is shown {found['shown']:.1f} times" in text
    assert f"{100 * found['textured']:.0f} % of the tile" in text


@pytest.mark.parametrize("name", ["quilt", "cut", "synth", "zoom"])
def test_v_measures_all_of_them(name, caplog):
    caplog.set_level("INFO", "oiiotex")
    MADE[name][1](session=Session(measure=True))
    assert f"--tex{name}: stationarity cost" in caplog.text and f"--tex{name}: sharpness loss" in caplog.text


def test_a_window_off_the_origin_and_a_cropped_photo_are_measured_alike(tmp_path):
    """The same copies of the same pixels have the same measures wherever the windows lie."""
    there = buffer(PHOTO)
    there.specmod().x, there.specmod().y = 30, -7
    there.specmod().full_x, there.specmod().full_width = -10, 500
    for photo, name in ((buffer(PHOTO), "a.json"), (there, "b.json")):
        filters.quilt(photo, size=(80, 64), report=tmp_path / name)
    assert measures(tmp_path / "a.json") == measures(tmp_path / "b.json")


def test_places_come_back_from_source_coordinates():
    spec = buffer(PHOTO).spec()
    y, x = np.random.default_rng(0).integers(0, 60, (2, 50, 40))
    spec.full_x, spec.full_width, spec.x, spec.y = -100, 4096, 7, 3
    found = SourceMap.of_coordinates(SourceMap.of(y, x).coordinates(spec), spec, "st")
    np.testing.assert_array_equal(found.yx, (y, x))


def test_variants_and_parts_of_a_set_are_reported_one_by_one(tmp_path):
    rough = PHOTO[..., :1].astype(np.float32)
    filters.stationarize(
        buffer(PHOTO), maps=[rough], variants=2, report=tmp_path / "r.json", fail=["repeat>1000"], **QUICK
    )
    document = json.loads((tmp_path / "r.json").read_text())
    assert [r["name"][:4] for r in document["results"]] == ["wang", "wang"]
    assert [limit["passed"] for limit in document["limits"]] == [True, True]


# --- limits ---


def test_a_limit_beyond_is_a_quality_error_that_holds_the_result(tmp_path):
    with pytest.raises(errors.QualityError) as caught:
        filters.quilt(buffer(PHOTO), tiles="xy", fail=["seam>0.01", "copied<0.001"], report=tmp_path / "r.json")
    assert re.search(r"seam is [\d.]+: fail=seam>0.01$", str(caught.value))
    np.testing.assert_array_equal(pixels(caught.value.result), pixels(filters.quilt(buffer(PHOTO), tiles="xy")))
    document = json.loads((tmp_path / "r.json").read_text())
    assert document["passed"] is False and len(document["failed"]) == 1
    assert [(limit["limit"], limit["passed"]) for limit in document["limits"]] == [
        ("seam>0.01", False),
        ("copied<0.001", True),
    ]


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"fail": ["sea>1"]}, "fail='sea>1': unknown measure 'sea', did you mean 'seam'"),
        ({"fail": ["seam=1"]}, "fail='seam=1': expected NAME>NUMBER or NAME<NUMBER"),
        ({"fail": ["seam>nan"]}, "expected NAME>NUMBER"),
        ({"fail": ["seam>1"], "tiles": "none"}, "fail='seam>1': seam is not measured for this result"),
        ({"fail": ["seam_y>1"], "tiles": "x"}, "seam_y is not measured"),
        ({"fail": ["textured<1"]}, "textured is not measured"),
        ({"fail": "seam>1"}, "expected a sequence of strings"),
    ],
)
def test_limits_that_make_no_sense_are_refused_before_the_work(given, said, monkeypatch):
    monkeypatch.setattr(synthesis_run, "synthesize", None)
    with pytest.raises(errors.ParameterError) as caught:
        filters.patchmatch(buffer(PHOTO), **given)
    assert said in str(caught.value)


def test_a_zoom_has_no_copies_to_be_judged_by():
    with refused(errors.ParameterError, parameter="fail", value="repeat>4"):
        filters.zoom(buffer(PHOTO), fail=["repeat>4"])


def test_what_does_not_fit_is_refused_with_the_figure_and_v_goes_on_without(tmp_path, caplog):
    caplog.set_level("INFO", "oiiotex")
    small = Session(budget=40 << 20, measure=True)
    values = {"size": (700, 700), "patch": 32}
    filters.quilt(buffer(PHOTO), session=small, **values)
    assert re.search(r"--texquilt: not measured: requires \d+ MB of memory", caplog.text)
    with refused(errors.ImageError, task="measuring the result", budget=40 << 20):
        filters.quilt(buffer(PHOTO), session=small, fail=["loss>1"], **values)


# --- on the command line ---


def test_the_exit_code_is_3_and_all_is_written(tmp_path):
    save(PHOTO, tmp_path / "photo.png")
    op = "--texquilt:size=48x48:tiles=xy:report=r.json:fail=seam>0.01,repeat>1000"
    done = oiiotex("photo.png", op, "-o", "tile.png", cwd=tmp_path)
    assert done.returncode == 3
    assert re.fullmatch(r"oiiotex FAIL: --texquilt : part0: seam is [\d.]+: fail=seam>0.01\n", done.stderr)
    assert (tmp_path / "tile.png").exists() and not json.loads((tmp_path / "r.json").read_text())["passed"]
    done = oiiotex("photo.png", op.replace("seam>0.01", "seam>1000"), "-o", "tile.png", cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    frames = ("--frames", "1-2", "--parallel-frames", "--threads", "2")
    done = oiiotex(
        *frames, "photo.png", "--texquilt:size=48x48:tiles=xy:fail=seam>0.01", "-o", "tile.#.png", cwd=tmp_path
    )
    assert done.returncode == 3 and (tmp_path / "tile.0002.png").exists()


def test_a_report_overwrites_nothing_that_is_read(tmp_path):
    save(PHOTO, tmp_path / "photo.png")
    done = oiiotex("photo.png", "--texquilt:report=photo.png", "-o", "tile.png", cwd=tmp_path)
    assert done.returncode == 1 and "report=photo.png would overwrite" in done.stderr


def test_the_page_names_every_measure():
    text = (ROOT / "docs" / "reference" / "report.md").read_text()
    assert SCHEMA in text
    assert re.findall(r"^\| `(\w+)` \| (.*) \|$", text, re.MULTILINE) == list(REPORT_MEASURES.items())


def test_a_photo_smaller_than_a_region_has_no_repetition_to_measure(tmp_path, caplog):
    small, path = pictures.pebbles(24, 30, seed=2), tmp_path / "r.json"
    filters.stationarize(buffer(small), iterations=1, patch=5, report=path, session=Session(measure=True))
    assert {"shown", "repeat"} & set(measures(path)) == set() and "copied" in measures(path)
    with pytest.raises(errors.QualityError, match="repeat is not measured"):
        filters.stationarize(buffer(small), iterations=1, patch=5, fail=["repeat>4"])


def test_the_mask_of_a_preset_is_among_the_parameters(tmp_path):
    photo = np.array(pictures.bricks(64, 72, seed=2))
    photo[12:40, 20:50] = 0.9, 0.1, 0.1
    filters.stationarize(buffer(photo), preset="clean", size=(48, 48), report=tmp_path / "r.json", **QUICK)
    assert json.loads((tmp_path / "r.json").read_text())["parameters"].endswith("mask=dominant")
