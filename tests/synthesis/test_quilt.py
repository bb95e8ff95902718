# SPDX-License-Identifier: Apache-2.0
"""--texquilt and --texcontent through the program and through Python: labels, guides, plans, and what is wrong."""

from __future__ import annotations

import functools
import json
import logging

import numpy as np
import OpenImageIO as oiio
import pytest

from oiiotex import filters
from oiiotex.analysis.labels import content_table
from oiiotex.engine import errors
from oiiotex.engine.session import Session
from oiiotex.synthesis.quilting import quilt_job
from oiiotex.synthesis.quilting.quilter import Rules
from tests import pictures
from tests.any_filter import buffer, ids, pixels
from tests.conftest import load, oiiotex, save

H, W = 144, 160
LABELS = np.where(np.indices((H, W))[1] < 80, 1, 2)
LABELS[72:, 80:] = 3
PHOTO = np.where((LABELS == 1)[..., None], pictures.bricks(H, W, 1), pictures.moss(H, W, 2))
PHOTO[LABELS == 3] = pictures.pebbles(H, W, 3)[LABELS == 3]
FINE = (LABELS - 1) * 2 + 1 + (np.indices((H, W))[0] // 6 % 2)
GUIDE = np.where(np.indices((60, 100)).sum(0) < 80, 1, 3)
GUIDE[:20, 70:] = 2


def labeled() -> dict[str, oiio.ImageBuf]:
    return {"photo": buffer(PHOTO), "label.1": ids(FINE, rho=8.0), "label.2": ids(LABELS, rho=33.0)}


def label_under(made: dict[str, oiio.ImageBuf]) -> np.ndarray:
    """The label of the source of every pixel, by the ST map."""
    st = pixels(made["st"])
    return LABELS[(st[..., 1] * H).astype(int), (st[..., 0] * W).astype(int)]


def away_from_borders(guide: np.ndarray, size: tuple[int, int], far: int) -> tuple[np.ndarray, np.ndarray]:
    height, width = size
    full = guide[np.arange(height) * guide.shape[0] // height][:, np.arange(width) * guide.shape[1] // width]
    inside = np.ones(full.shape, bool)
    for y in range(-far, far + 1, far):
        for x in range(-far, far + 1, far):
            inside &= np.roll(full, (y, x), (0, 1)) == full
    return full, inside


def test_a_guide_of_ids_is_followed():
    made = filters.quilt(labeled(), guide=ids(GUIDE), size=(400, 240), st=True)
    full, inside = away_from_borders(GUIDE, (240, 400), 16)
    assert 0.4 < inside.mean() < 0.95
    assert (label_under(made) == full)[inside].mean() > 0.9


def test_a_guide_of_colors_means_what_the_table_says(tmp_path, monkeypatch):
    colors = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    guide = buffer(colors[GUIDE], oiio.UINT8, "")
    table = tmp_path / "table.json"
    table.write_text(json.dumps({"255,0,0": 1, "0,255,0": [2, 2], "0,0,255": 3}))
    # prices of use carry a difference at a border on to all later cells
    monkeypatch.setattr(quilt_job, "FREE_USES", 1e9)
    monkeypatch.setattr(quilt_job, "Rules", functools.partial(Rules, guidance=0.0))
    values = {"size": (400, 240), "st": True}
    made = filters.quilt(labeled(), guide=guide, palette=table, **values)
    plain = filters.quilt(labeled(), guide=ids(GUIDE), **values)
    full, inside = away_from_borders(GUIDE, (240, 400), 16)
    assert (label_under(made) == full)[inside].mean() > 0.9
    assert (pixels(made["st"]) == pixels(plain["st"])).mean() > 0.5  # borders with a pair differ
    table.write_text(json.dumps({"1": 1, "2": 2, "3": 3}))
    by_id = filters.quilt(labeled(), guide=ids(GUIDE), palette=table, **values)
    np.testing.assert_array_equal(pixels(by_id["st"]), pixels(plain["st"]))


def test_labels_of_finer_levels_tell_candidates_apart(monkeypatch):
    made = []
    for weight in (0.0, 50.0):
        monkeypatch.setattr(quilt_job, "Rules", functools.partial(Rules, finer=weight))
        made.append(filters.quilt(labeled(), label=1, labellevel=2, size=(300, 300), st=True))
    assert (pixels(made[0]["st"]) != pixels(made[1]["st"])).any()


def test_a_label_and_a_mask_are_all_that_is_taken():
    made = filters.quilt(labeled(), label=3, size=(200, 200), st=True)
    assert (label_under(made) == 3).all()
    masked = filters.quilt(labeled(), mask=buffer((LABELS == 3)[..., None] * 1.0), size=(200, 200), st=True)
    assert (label_under(masked) == 3).all()


def test_the_level_gives_the_patch(caplog):
    with caplog.at_level(logging.INFO, "oiiotex"):
        filters.quilt(labeled(), labellevel=2, size=(64, 64))
        filters.quilt(buffer(PHOTO), size=(64, 64))
    said = [r.getMessage() for r in caplog.records if "patches of" in r.getMessage()]
    assert ["patches of 32 px" in said[0], "patches of 16 px" in said[1]] == [True, True]


def test_label_parts_follow_where_they_are_kept():
    made = filters.quilt(labeled(), size=(100, 90), labelmaps=True, st=True)
    assert list(made) == ["quilt", "st", "label.1", "label.2"]
    assert made["label.2"].spec().format == oiio.UINT32
    np.testing.assert_array_equal(pixels(made["label.2"])[..., 0], label_under(made))


def test_a_plan_renders_the_same_pixels_and_those_of_another_map(tmp_path):
    save(PHOTO, tmp_path / "photo.exr", "half", "ACEScg")
    normals = np.random.default_rng(0).random((H, W, 3))
    save(normals, tmp_path / "normal.exr", "float", "data")
    plan, again = "--texquilt:size=200x180:tiles=xy:planfile=p.npz", "--texquilt:fromplan=p.npz"
    for words in (
        ("photo.exr", f"{plan}:st=st.exr", "-o", "a.exr"),
        ("photo.exr", again, "-o", "b.exr"),
        ("normal.exr", again, "-o", "c.exr"),
        ("normal.exr", "st.exr", "--texwarp", "-o", "d.exr"),
    ):
        done = oiiotex(*words, cwd=tmp_path)
        assert done.returncode == 0, done
    np.testing.assert_array_equal(load(tmp_path / "a.exr"), load(tmp_path / "b.exr"))
    np.testing.assert_array_equal(load(tmp_path / "c.exr"), load(tmp_path / "d.exr"))


def test_a_key_that_no_patch_has_falls_back_and_is_said_once(caplog):
    few = LABELS.copy()
    few[few == 2] = 1
    few[10:14, 100:104] = 2  # too small for a patch of its own
    photo = {"photo": buffer(PHOTO), "label.1": ids(few)}
    with caplog.at_level(logging.WARNING, "oiiotex"):
        filters.quilt(photo, guide=ids(GUIDE), size=(200, 120), patch=32)
    said = [r.getMessage() for r in caplog.records]
    assert len(said) == 1 and "(2, 2) ->" in said[0]


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"guide": ids(GUIDE + 6)}, r"ids without a label: 9 \(\d+ samples, first at \d+,\d+\), 7 "),
        (
            {"guide": buffer(GUIDE[..., None] * np.ones(3), oiio.UINT8)},
            "contains colors; map them to labels with palette=FILE.json",
        ),
        ({"guide": ids(GUIDE), "label": 1}, "guide conflicts with label"),
        ({"palette": "a.json"}, "palette requires guide"),
        ({"guide": ids(GUIDE), "palette": "absent.json"}, "cannot be read .*: expected a file of"),
        ({"label": 9}, "label=9: not in label.2, whose ids are 1 to 3"),
        ({"labellevel": 3}, "labellevel=3: expected one of 1, 2"),
        ({"mask": ids(LABELS[:, :-1])}, "mask is 159x144, but the exemplar is 160x144"),
        ({"label": 3, "patch": 90}, "no patch of 90 px fits .* the largest square is 72 px; use patch=72"),
        ({"mask": ids((np.indices((H, W)).sum(0) % 4 > 0) * 1)}, "the largest square is 2 px|no patch"),
        ({"patch": 200}, "no patch of 200 px fits"),
        ({"tiles": "x", "size": (20, 90), "patch": 24}, "the tile is 20 px wide: expected at least 24 px"),
        ({"fromplan": "absent.npz"}, "absent.npz: cannot read arrays: No such file"),
        ({"fromplan": "absent.npz", "patch": 24}, "fromplan conflicts with size"),
        ({"tiles": "z"}, "'none' | 'x' | 'y' | 'xy'"),
        ({"size": (0, 4)}, r"\(width, height\) from 1"),
    ],
)
def test_what_is_wrong_is_said(values, said):
    with pytest.raises(errors.Error, match=said):
        filters.quilt(labeled(), **values)


def test_a_label_map_of_another_size_is_refused():
    with pytest.raises(errors.ImageError, match=r"label.1 is 160x143, but the exemplar is 160x144"):
        filters.quilt({"photo": buffer(PHOTO), "label.1": ids(LABELS[:-1])}, label=1)


@pytest.mark.parametrize(
    ("table", "said"),
    [
        ({}, "is empty"),
        ({"255,0": 1}, "cannot be read .*: expected a file of"),
        ({"256,0,0": 1}, "cannot be read .*: expected a file of"),
        ({"1": 9}, r"unknown label \[9, 9\]: expected a label from 1 to 3, or a pair"),
        ({"1": [1, 2, 3]}, "unknown label .*: expected a label from 1 to 3, or a pair"),
        ({"1": 1, "255,0,0": 2}, "mixes colors and ids"),
        ({"255,0,255": 1}, "colors without a label"),
    ],
)
def test_what_is_wrong_with_a_table_is_said(table, said, tmp_path):
    path = tmp_path / "table.json"
    path.write_text(json.dumps(table))
    with pytest.raises(errors.ImageError, match=said):
        filters.quilt(labeled(), guide=ids(GUIDE), palette=path)


def test_a_plan_of_another_size_is_refused(tmp_path):
    filters.quilt(buffer(PHOTO), size=(64, 64), planfile=tmp_path / "p.npz")
    with pytest.raises(errors.ImageError, match=r"160x144.* 100x144"):
        filters.quilt(buffer(PHOTO[:, :100]), fromplan=tmp_path / "p.npz")


# --- texcontent ---


def test_content_marks_all_patches_of_the_key(tmp_path):
    made = filters.content(labeled(), center=(80, 20), labellevel=2, patch=16, facts=tmp_path / "c.json")
    facts = json.loads((tmp_path / "c.json").read_text())
    first, second = content_table.window_keys(LABELS, 16)
    same = (first == facts["key"][0]) & (second == facts["key"][1])
    assert facts["key"] == [1, 2] and facts["patches"] == np.count_nonzero(same)
    assert facts["histograms"]["label.2"] == {"1": 128, "2": 128}
    assert sum(facts["histograms"]["label.1"].values()) == 256
    assert sum(k["patches"] for k in facts["keys"]) == first.size
    shown = pixels(made).astype(int)
    red = np.zeros((H, W), bool)
    red[8 : 8 + same.shape[0], 8 : 8 + same.shape[1]] = same
    outline = shown[..., 2] > shown[..., 0] + 60
    assert (shown[..., 0] - shown[..., 2] > 60)[red & ~outline].all()
    assert (shown[..., 0] - shown[..., 2] > 60)[~red].mean() < 0.01


def test_content_says_the_histograms_of_every_level(tmp_path):
    said: list[str] = []
    filters.content(labeled(), center=(80, 20), labellevel=2, patch=16, session=Session(say=said.append))
    assert said[1:] == ["label.2: 1: 50.0%, 2: 50.0%", f"key (1, 2) of label.2: {said[2].split()[-2]} patches"]
    assert said[0].startswith("label.1: ")
    save(PHOTO, tmp_path / "photo.exr", "half", "ACEScg")
    done = oiiotex("photo.exr", "--texlabel:photo=1", "--texcontent", "-o", "content.png", cwd=tmp_path)
    assert done.returncode == 0 and done.stdout.startswith("label.1: ") and " patches\n" in done.stdout


def test_content_draws_the_table_of_keys():
    made = pixels(filters.content(labeled(), labellevel=2, patch=16, keys=True))
    assert made.shape == (48 + 3 * 76, 48 + 3 * 76, 3)
    shown = {
        (i, j): made[52 + 76 * i : 116 + 76 * i, 52 + 76 * j : 116 + 76 * j].std() > 5
        for i in range(3)
        for j in range(3)
    }
    present = set(map(tuple, np.stack(content_table.window_keys(LABELS, 16), -1).reshape(-1, 2).tolist()))
    assert shown == {(i, j): (i + 1, j + 1) in present for i in range(3) for j in range(3)}


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"center": (500, 3)}, "expected a point in the data window"),
        ({"center": (3,)}, "expected two numbers"),
        ({"labellevel": 7}, "labellevel=7: expected one of 1, 2"),
        ({"patch": 150}, "patch=150: exceeds photo"),
    ],
)
def test_what_is_wrong_with_content_is_said(values, said):
    with pytest.raises(errors.Error, match=said):
        filters.content(labeled(), **values)
