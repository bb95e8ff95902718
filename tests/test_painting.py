# SPDX-License-Identifier: Apache-2.0
"""--texpalette and --texpaint: from a photo's labels to a painting, and what an edit of it may touch."""

from __future__ import annotations

import json

import numpy as np
import OpenImageIO as oiio
import pytest

from oiiotex import errors, filters
from oiiotex.filters.palette import distinct
from oiiotex.session import Session
from oiiotex.synthesis import layers
from oiiotex.synthesis.seams import Source, seam_costs
from oiiotex.tiles import PieceCache
from oiiotex.windows import Window
from tests import pictures
from tests.conftest import load, oiiotex, save
from tests.test_labelgrowth import ids_buffer
from tests.test_promises import buffer, pixels

SIDE = 160
Y, X = np.indices((SIDE, SIDE))
COARSE = (1 + (X >= SIDE // 2)).astype(np.uint32)
FINE = (COARSE * 2 - 1 + (Y // 20 % 2)).astype(np.uint32)  # 1, 2 within 1; 3, 4 within 2
TINTS = np.array([[0.2, 0.5, 0.2], [0.1, 0.25, 0.1], [0.7, 0.4, 0.3], [0.9, 0.8, 0.6]])
PHOTO = np.clip(TINTS[FINE.astype(int) - 1] + 0.15 * (pictures.moss(SIDE, SIDE, 3) - 0.5), 0, 1)


def photo(**more: oiio.ImageBuf) -> dict[str, oiio.ImageBuf]:
    fine = ids_buffer(FINE)
    fine.specmod().attribute("oiiotex:parents", "1,1,2,2")
    return {"photo": buffer(PHOTO), "label.1": fine, "label.2": ids_buffer(COARSE), **more}


def disc(height: int = 240, width: int = 260, inner: int = 2, outer: int = 1) -> np.ndarray:
    y, x = np.indices((height, width))
    return np.where((y - 120) ** 2 + (x - 130) ** 2 < 80**2, inner, outer)


# --- the palette ---


@pytest.fixture(scope="module")
def palette(tmp_path_factory):
    folder = tmp_path_factory.mktemp("palette")
    made = filters.palette(photo(), side=48, json=folder / "p.json", stmap=True)
    return made, json.loads((folder / "p.json").read_text()), folder / "p.json"


def test_every_swatch_is_its_label_alone(palette):
    made, facts, _ = palette
    places = (pixels(made["st"]) * SIDE).astype(int)
    assert places.shape == (96, 48 * 10, 2)
    covered = np.zeros(places.shape[:2], int)
    for level, maps in (("labels", COARSE), ("finer", FINE)):
        for entry in facts[level]:
            left, top, width, height = entry["box"]
            at = places[top : top + height, left : left + width].reshape(-1, 2)
            covered[top : top + height, left : left + width] += 1
            assert (maps[at[:, 1], at[:, 0]] == entry["id"]).all()
    assert (covered == 1).all()  # no pixel of the picture is left over, none is claimed twice


def test_the_json_says_what_there_is(palette):
    _, facts, _ = palette
    assert facts["level"] == 2
    assert {e["id"]: (e["area"], e["children"]) for e in facts["labels"]} == {
        1: (SIDE**2 // 2, [1, 2]), 2: (SIDE**2 // 2, [3, 4]),
    }  # fmt: skip
    assert {e["id"]: e["parent"] for e in facts["finer"]} == {1: 1, 2: 1, 3: 2, 4: 2}
    assert [e["name"] for e in facts["labels"]] == ["label.2/1", "label.2/2"]
    for entry in facts["finer"]:  # the colour is the label's mean, as it looks
        shown = np.array([int(n) for n in entry["colour"].split(",")]) / 255
        assert np.abs(shown - PHOTO[entry["id"] == FINE].mean(0)).max() < 0.03


def test_colours_to_paint_with_are_never_the_same():
    same = np.full((300, 3), 0.4)
    black = np.zeros((30, 3))
    found = distinct(np.concatenate([same, black, np.ones((10, 3))]))
    assert len(set(found)) == 340 and (0, 0, 0) not in found
    assert np.abs(np.array(found[:300]) - 102).max() <= 4  # and near to what they stand for
    assert all(0 <= n <= 255 for colour in found for n in colour)


def test_thin_labels_and_levels_without_children_have_swatches():
    thin = (1 + (X % 40 < 3)).astype(np.uint32)
    made = filters.palette({"photo": buffer(PHOTO), "label.1": ids_buffer(thin)}, side=32, stmap=True)
    at = (pixels(made["st"]) * SIDE).astype(int)
    assert at.shape == (64, 64, 2)
    assert (thin[at[:32, :, 1], at[:32, :, 0]] == 1).all() and (thin[at[32:, :, 1], at[32:, :, 0]] == 2).all()


# --- painting ---


def painted_labels(made: oiio.ImageBuf, labels: np.ndarray) -> np.ndarray:
    at = (pixels(made["st"]) * SIDE).astype(int)
    return labels[at[..., 1], at[..., 0]]


def coloured(ids: np.ndarray, entries: list[dict]) -> oiio.ImageBuf:
    """A painting in a palette's colours; 0 is black."""
    colours = np.zeros((max(e["id"] for e in entries) + 1, 3))
    for entry in entries:
        colours[entry["id"]] = [int(n) / 255 for n in entry["colour"].split(",")]
    return buffer(colours[ids], oiio.UINT8, "")


def test_a_painting_of_ids_and_one_of_colours_are_followed(palette):
    _, facts, table = palette
    made = filters.paint(photo(), ids_buffer(disc()), patch=16, stmap=True)
    found = painted_labels(made, COARSE)
    assert found.shape == (240, 260)
    near = np.abs(np.hypot(*(np.indices(found.shape) - np.array([120, 130])[:, None, None])) - 80) < 12
    assert (found == disc())[~near].mean() > 0.97
    by_colour = filters.paint(photo(), coloured(disc(), facts["labels"]), table=table, patch=16)
    np.testing.assert_array_equal(pixels(by_colour), pixels(made["paint"]))


def test_a_fine_painting_lies_over_the_coarse_one(palette):
    _, facts, table = palette
    fine = np.zeros((240, 260), int)
    fine[20:110, 20:90], fine[100:150, 100:160] = 2, 3  # elsewhere nothing is painted
    made = filters.paint(
        photo(), coloured(disc(), facts["labels"]), fine=coloured(fine, facts["finer"]), table=table, patch=16,
        stmap=True,
    )  # fmt: skip
    alone = filters.paint(photo(), ids_buffer(disc()), patch=16, stmap=True)
    found = painted_labels(made, FINE)
    for place, label in (((slice(28, 102), slice(28, 82)), 2), ((slice(108, 142), slice(108, 152)), 3)):
        assert (found[place] == label).mean() > 0.95
        assert (painted_labels(alone, FINE)[place] == label).mean() < 0.8  # which the coarse painting does not say
    far = np.ones(fine.shape, bool)
    far[16:154, 16:164] = False
    np.testing.assert_array_equal(pixels(made["paint"])[far], pixels(alone["paint"])[far])


@pytest.mark.parametrize("with_fine", [False, True])
def test_a_local_edit_changes_nothing_elsewhere(with_fine, tmp_path):
    """Same pixels to the bit outside the edited region and a seam band of one patch (with fine: and a tile)."""
    patch, painting = 16, disc(300, 320)
    edited = painting.copy()
    edited[210:240, 250:290] = 2
    fine = np.zeros(painting.shape, int)
    fine[30:90, 40:120] = 2
    more = {"fine": ids_buffer(fine)} if with_fine else {}
    before = filters.paint(photo(), ids_buffer(painting), patch=patch, plan=tmp_path / "a.npz", **more)
    after = filters.paint(photo(), ids_buffer(edited), before=tmp_path / "a.npz", plan=tmp_path / "b.npz", **more)
    touched = np.zeros(painting.shape, bool)
    touched[210 - patch : 240 + patch, 250 - patch : 290 + patch] = True
    changed = (pixels(before) != pixels(after)).any(-1)
    assert not changed[~touched].any()
    assert changed[215:235, 255:285].mean() > 0.9  # the edit itself is there
    from_nothing = filters.paint(photo(), ids_buffer(edited), patch=patch, **more)
    assert (pixels(before) != pixels(from_nothing)).any(-1)[~touched].any()  # what the plan is kept for
    undone = filters.paint(photo(), ids_buffer(edited), before=tmp_path / "b.npz", **more)
    np.testing.assert_array_equal(pixels(undone), pixels(after))  # nothing edited, nothing changed


def test_an_edit_of_the_fine_painting_leaves_the_rest(tmp_path):
    fine = np.zeros((300, 320), int)
    fine[30:90, 40:120] = 2
    edited = fine.copy()
    edited[200:240, 200:260] = 3
    given = {"painting": ids_buffer(disc(300, 320)), "plan": tmp_path / "a.npz", "patch": 16}
    painting = given.pop("painting")
    before = filters.paint(photo(), painting, fine=ids_buffer(fine), **given)
    after = filters.paint(photo(), painting, fine=ids_buffer(edited), before=tmp_path / "a.npz")
    touched = np.zeros(fine.shape, bool)
    touched[200 - 16 : 240 + 16, 200 - 16 : 260 + 16] = True
    changed = (pixels(before) != pixels(after)).any(-1)
    assert changed[205:235, 205:255].mean() > 0.5 and not changed[~touched].any()


def test_a_plan_of_a_painting_is_one_of_a_quilt(tmp_path):
    made = filters.paint(photo(), ids_buffer(disc()), patch=16, plan=tmp_path / "a.npz")
    again = filters.quilt(buffer(PHOTO), plan=tmp_path / "a.npz", render=True)
    np.testing.assert_array_equal(pixels(made), pixels(again))


def test_what_is_wrong_is_said(palette, tmp_path):
    _, facts, table = palette
    stray = coloured(disc(), facts["labels"])
    oiio.ImageBufAlgo.render_box(stray, 100, 100, 140, 140, (1, 0, 1), True)
    with pytest.raises(errors.ImageError, match=r"colours that mean no label: 255,0,255 \(\d+ samples\)"):
        filters.paint(photo(), stray, table=table, patch=16)
    fine = coloured(disc(inner=3, outer=0), facts["finer"])
    oiio.ImageBufAlgo.render_box(fine, 100, 100, 110, 110, (1, 0, 1), True)
    with pytest.raises(errors.ImageError, match=r"fine painting has colours that mean no label: 255,0,255 \(\d+ px\)"):
        filters.paint(photo(), ids_buffer(disc()), fine=fine, table=table, patch=16)
    with pytest.raises(errors.ParameterError, match="fine holds colours"):
        filters.paint(photo(), ids_buffer(disc()), fine=fine, patch=16)
    with pytest.raises(errors.ParameterError, match="below level=1"):
        filters.paint(photo(), ids_buffer(disc()), fine=ids_buffer(disc()), level=1, patch=16)
    (tmp_path / "bad.json").write_text('{"labels": 3}')
    with pytest.raises(errors.ImageError, match=r"bad\.json: no palette"):
        filters.paint(photo(), stray, table=tmp_path / "bad.json")
    facts["labels"][0]["id"] = 9
    (tmp_path / "more.json").write_text(json.dumps(facts))
    with pytest.raises(errors.ImageError, match="names label 9"):
        filters.paint(photo(), stray, table=tmp_path / "more.json")
    filters.paint(photo(), ids_buffer(disc()), patch=16, plan=tmp_path / "a.npz")
    with pytest.raises(errors.ImageError, match="is of 260x240 in patches of 16 px, this is 100x90"):
        filters.paint(photo(), ids_buffer(disc()), size=(100, 90), before=tmp_path / "a.npz")
    filters.quilt(photo(), patch=16, plan=tmp_path / "q.npz")
    with pytest.raises(errors.ImageError, match="does not say what was painted"):
        filters.paint(photo(), ids_buffer(disc()), before=tmp_path / "q.npz")
    with pytest.raises(errors.ImageError, match="no label parts"):
        filters.paint(buffer(PHOTO), ids_buffer(disc()))
    with pytest.raises(errors.ImageError, match=r"a palette of 160x160 needs \d+ MB"):
        filters.palette(photo(), session=Session(budget=1 << 20))


@pytest.mark.slow
def test_from_photo_to_painting_on_the_command_line(tmp_path):
    save(PHOTO, tmp_path / "photo.png")
    lines = [
        ("photo.png", "--iscolorspace", "sRGB", "--texlabel:keep=1", "-o", "labelled.exr"),
        ("labelled.exr", "--texpalette:json=p.json:side=32", "-o", "palette.exr"),
    ]
    for line in lines:
        done = oiiotex(*line, cwd=tmp_path)
        assert done.returncode == 0, done.stderr
    facts = json.loads((tmp_path / "p.json").read_text())
    first, second = (facts["labels"][n]["colour"] for n in (0, -1))
    painting = np.array([[int(n) / 255 for n in c.split(",")] for c in (first, second)])
    save(painting[(disc() > 1).astype(int)], tmp_path / "painting.png")
    line = ("labelled.exr", "painting.png", "--texpaint:table=p.json:patch=16:plan=plan.npz", "-o")
    found = []
    for more, name in (((), "a.exr"), (("--threads", "1", "--cache", "600"), "b.exr")):
        done = oiiotex(*line, name, *more, cwd=tmp_path)
        assert done.returncode == 0, done.stderr
        found.append(load(tmp_path / name))
    assert found[0].shape == (240, 260, 3) and (tmp_path / "plan.npz").is_file()
    np.testing.assert_array_equal(*found)


# --- one texture over another ---


def test_layers_are_cut_in_a_band_and_any_window_is_the_whole_cropped():
    random = np.random.default_rng(0)
    lab = (pictures.pebbles(60, 70, 3) * 400).astype(np.int16)
    whole = Window(0, 0, 300, 280)
    mask = disc(280, 300, 1, 0) > 0
    below, above = (random.integers(0, 4200, (2, 280, 300))).astype(np.uint32)
    above[:] = (np.arange(280)[:, None] % 60) * 70 + np.arange(300) % 70
    below[:] = ((np.arange(280)[:, None] + 17) % 60) * 70 + (np.arange(300) + 31) % 70

    def made() -> layers.Layers:
        return layers.Layers(
            lab, lambda w: below[w.inside(whole)], lambda w: (mask[w.inside(whole)], above[w.inside(whole)]), whole, 8
        )

    found = made().sources(whole, PieceCache(1 << 24))
    for window in (Window(3, 5, 140, 200), Window(127, 100, 129, 280), Window(200, 250, 300, 280)):
        np.testing.assert_array_equal(made().sources(window, PieceCache(1 << 24)), found[window.inside(whole)])
    y, x = np.indices(mask.shape)
    away = np.abs(np.hypot(y - 120, x - 130) - 80)
    np.testing.assert_array_equal(found[away > 12], np.where(mask, above, below)[away > 12])
    assert (found != np.where(mask, above, below)).any()  # the cut strays from the mask, to where it is cheaper

    def cost(flat: np.ndarray) -> int:
        places = np.stack(np.divmod(flat.astype(np.int64), 70))
        near = away < 14
        right, down = seam_costs(Source(lab), places, np.ones(mask.shape, bool))
        return int(right[near[:, 1:]].sum() + down[near[1:]].sum())

    assert cost(found) < cost(np.where(mask, above, below))


@pytest.mark.parametrize("value", [False, True])
def test_a_mask_without_a_border_is_no_cut(value):
    lab, whole = np.zeros((9, 9, 3), np.int16), Window(0, 0, 130, 20)
    below, above = np.zeros((20, 130), np.uint32), np.ones((20, 130), np.uint32)
    laid = layers.Layers(
        lab, lambda w: below[w.inside(whole)], lambda w: (np.full((w.height, w.width), value), above[w.inside(whole)]),
        whole, 4,
    )  # fmt: skip
    assert (laid.sources(whole, PieceCache(1 << 20)) == int(value)).all()
