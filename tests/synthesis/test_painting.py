# SPDX-License-Identifier: Apache-2.0
"""--texpalette and --texpaint: from a photo's labels to a painting, and what an edit of it may touch."""

from __future__ import annotations

import json
import re

import numpy as np
import OpenImageIO as oiio
import pytest

from oiiotex import filters
from oiiotex.analysis.labels.legend import codes_of, color_of, colors_of
from oiiotex.engine import errors
from oiiotex.engine.core.image import from_buffer
from oiiotex.engine.core.parameters import Size
from oiiotex.engine.core.piece_cache import PieceCache
from oiiotex.engine.core.source_map import SourceMap
from oiiotex.engine.core.window import Window
from oiiotex.engine.session import Session
from oiiotex.surfaces.charts.drawing import colored
from oiiotex.synthesis.graphcut import seam_overlay
from oiiotex.synthesis.graphcut.seams import SeamPhoto, seam_costs
from oiiotex.synthesis.quilting import label_painting, quilt_job
from oiiotex.synthesis.quilting.guide_map import meaning_of, read_table
from tests import pictures
from tests.any_filter import buffer, pixels
from tests.conftest import load, oiiotex, save
from tests.refusals import refused
from tests.synthesis.test_labelgrowth import ids_buffer

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
    made = filters.palette(photo(), panel=48, facts=folder / "p.json", st=True)
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
    assert {e["id"]: e["parents"] for e in facts["finer"]} == {1: [1], 2: [1], 3: [2], 4: [2]}
    assert [e["name"] for e in facts["labels"]] == ["label.2/1", "label.2/2"]
    for entry in facts["finer"]:  # the color is that in which --texlabelview shows the label
        shown = colored(np.full((1, 1), entry["id"]), None, 1.0)[0, 0]
        assert entry["color"] == ",".join(str(n) for n in np.rint(255 * shown).astype(int))


def test_colors_to_paint_with_are_never_the_same():
    ids = np.arange(1, 100_000)
    codes = codes_of(ids)
    assert len(np.unique(codes)) == len(ids) and codes.min() > 0
    found = np.array([[int(n) for n in color_of(code).split(",")] for code in codes.tolist()])
    assert found.min() >= 0 and found.max() <= 255
    apart = np.abs(found - 255 * colors_of(ids)).max(-1)  # and near to those in which they are shown
    assert apart.max() < 13 and apart[:48].max() <= 0.5


def test_thin_labels_and_levels_without_children_have_swatches():
    thin = (1 + (X % 40 < 3)).astype(np.uint32)
    made = filters.palette({"photo": buffer(PHOTO), "label.1": ids_buffer(thin)}, panel=32, st=True)
    at = (pixels(made["st"]) * SIDE).astype(int)
    assert at.shape == (64, 64, 2)
    assert (thin[at[:32, :, 1], at[:32, :, 0]] == 1).all() and (thin[at[32:, :, 1], at[32:, :, 0]] == 2).all()


# --- painting ---


def painted_labels(made: oiio.ImageBuf, labels: np.ndarray) -> np.ndarray:
    at = (pixels(made["st"]) * SIDE).astype(int)
    return labels[at[..., 1], at[..., 0]]


def painted(ids: np.ndarray, entries: list[dict]) -> oiio.ImageBuf:
    """A painting in a palette's colors; 0 is black."""
    colors = np.zeros((max(e["id"] for e in entries) + 1, 3))
    for entry in entries:
        colors[entry["id"]] = [int(n) / 255 for n in entry["color"].split(",")]
    return buffer(colors[ids], oiio.UINT8, "")


def test_a_painting_of_ids_and_one_of_colors_are_followed(palette):
    _, facts, table = palette
    made = filters.paint(photo(), ids_buffer(disc()), patch=16, st=True)
    found = painted_labels(made, COARSE)
    assert found.shape == (240, 260)
    near = np.abs(np.hypot(*(np.indices(found.shape) - np.array([120, 130])[:, None, None])) - 80) < 12
    assert (found == disc())[~near].mean() > 0.97
    by_color = filters.paint(photo(), painted(disc(), facts["labels"]), palette=table, patch=16)
    np.testing.assert_array_equal(pixels(by_color), pixels(made["paint"]))


def test_a_fine_painting_lies_over_the_coarse_one(palette):
    _, facts, table = palette
    fine = np.zeros((240, 260), int)
    fine[20:110, 20:90], fine[100:150, 100:160] = 2, 3  # elsewhere nothing is painted
    made = filters.paint(
        photo(), painted(disc(), facts["labels"]), fine=painted(fine, facts["finer"]), palette=table, patch=16,
        st=True,
    )  # fmt: skip
    # what the coarse painting does not say is up to chance: all of a place or nothing of it, by the seed
    without = [filters.paint(photo(), ids_buffer(disc()), patch=16, st=True, seed=seed) for seed in range(4)]
    found, alone = painted_labels(made, FINE), without[0]
    for place, label in (((slice(28, 102), slice(28, 82)), 2), ((slice(108, 142), slice(108, 152)), 3)):
        assert (found[place] == label).mean() > 0.95
        assert np.mean([painted_labels(one, FINE)[place] == label for one in without]) < 0.8
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
    before = filters.paint(photo(), ids_buffer(painting), patch=patch, planfile=tmp_path / "a.npz", **more)
    after = filters.paint(photo(), ids_buffer(edited), fromplan=tmp_path / "a.npz", planfile=tmp_path / "b.npz", **more)
    touched = np.zeros(painting.shape, bool)
    touched[210 - patch : 240 + patch, 250 - patch : 290 + patch] = True
    changed = (pixels(before) != pixels(after)).any(-1)
    assert not changed[~touched].any()
    assert changed[215:235, 255:285].mean() > 0.9  # the edit itself is there
    from_nothing = filters.paint(photo(), ids_buffer(edited), patch=patch, **more)
    assert (pixels(before) != pixels(from_nothing)).any(-1)[~touched].any()  # what the plan is kept for
    undone = filters.paint(photo(), ids_buffer(edited), fromplan=tmp_path / "b.npz", **more)
    np.testing.assert_array_equal(pixels(undone), pixels(after))  # nothing edited, nothing changed


def test_an_edit_of_the_fine_painting_leaves_the_rest(tmp_path):
    fine = np.zeros((300, 320), int)
    fine[30:90, 40:120] = 2
    edited = fine.copy()
    edited[200:240, 200:260] = 3
    given = {"painting": ids_buffer(disc(300, 320)), "planfile": tmp_path / "a.npz", "patch": 16}
    painting = given.pop("painting")
    before = filters.paint(photo(), painting, fine=ids_buffer(fine), **given)
    after = filters.paint(photo(), painting, fine=ids_buffer(edited), fromplan=tmp_path / "a.npz")
    touched = np.zeros(fine.shape, bool)
    touched[200 - 16 : 240 + 16, 200 - 16 : 260 + 16] = True
    changed = (pixels(before) != pixels(after)).any(-1)
    assert changed[205:235, 205:255].mean() > 0.5 and not changed[~touched].any()


def test_a_plan_of_a_painting_is_one_of_a_quilt(tmp_path):
    made = filters.paint(photo(), ids_buffer(disc()), patch=16, planfile=tmp_path / "a.npz")
    again = filters.quilt(buffer(PHOTO), fromplan=tmp_path / "a.npz")
    np.testing.assert_array_equal(pixels(made), pixels(again))


def test_repetition_of_a_painted_label_is_reported_and_capped(tmp_path, monkeypatch):
    """A label of small spots over a whole painting: without prices, what lies in one spot repeats."""
    spots = np.where(np.hypot(X % 80 - 30, Y % 80 - 30) < 14, 2, 1).astype(np.uint32)
    values = np.where(spots[..., None] == 2, [0.8, 0.6, 0.4], [0.2, 0.25, 0.2]) + 0.2 * pictures.moss(SIDE, SIDE, 3)
    given = {"photo": buffer(np.clip(values, 0, 1)), "label.1": ids_buffer(spots)}
    painted = np.full((256, 256), 2, np.uint32)
    measured = {}
    for reuse in (1.0, 1e9):
        path = tmp_path / f"{reuse:g}.json"
        monkeypatch.setattr(quilt_job, "FREE_USES", reuse)
        filters.paint(given, ids_buffer(painted), patch=16, report=path)
        measured[reuse] = json.loads(path.read_text())["results"][0]["measures"]
        assert measured[reuse]["label"] == 2
        assert measured[reuse]["label_repeat"] == pytest.approx(
            measured[reuse]["label_shown"] * (spots == 2).sum() / painted.size
        )
    assert measured[1.0]["label_repeat"] < 0.75 * measured[1e9]["label_repeat"], measured
    assert measured[1.0]["label_repeat"] < 1.5, measured
    with pytest.raises(errors.QualityError, match="label_repeat"):
        filters.paint(given, ids_buffer(painted), patch=16, fail=["label_repeat>0.1"])
    with refused(errors.ParameterError, parameter="fail", value="label_repeat>3"):
        filters.quilt(given["photo"], patch=16, fail=["label_repeat>3"])


def test_soft_brushes_are_taken_for_the_nearest_color(palette, caplog):
    _, facts, table = palette
    inside = disc() == 2
    weight = np.clip((80 - np.hypot(*(np.indices(inside.shape) - [[[120]], [[130]]]))) / 24 + 0.5, 0, 1)[..., None]
    first, second = (np.array([int(n) for n in e["color"].split(",")]) / 255 for e in _by_id(facts["labels"]))
    soft = buffer(second * weight + first * (1 - weight))
    with caplog.at_level("WARNING"):
        made = filters.paint(photo(), soft, palette=table, patch=16, st=True)
        hard = filters.paint(photo(), painted(disc(), facts["labels"]), palette=table, patch=16, st=True)
    assert re.search(r"\d+ % of the samples match no color of the table; nearest color used", caplog.text)
    assert len(caplog.records) == 1  # the hard one has no such colors
    shares = [(painted_labels(one, COARSE) == 2)[inside].mean() for one in (made, hard)]
    assert shares[0] > shares[1] - 0.02


def test_a_soft_fine_painting_ends_where_it_covers_less_than_half(palette):
    _, facts, table = palette
    third = _by_id(facts["finer"])[2]
    color = np.array([int(n) for n in third["color"].split(",")]) / 255
    alpha = np.clip((80 - np.hypot(*(np.indices((240, 260)) - [[[120]], [[130]]]))) / 24 + 0.5, 0, 1)[..., None]
    fine = buffer(np.concatenate([color * alpha, alpha], -1), names=("R", "G", "B", "A"))
    meaning = meaning_of(fine_part := from_buffer(fine).first, read_table(table), np.arange(1, 5), fine=True)
    labels = label_painting.painted_labels(fine_part, meaning, Size(260, 240))(Window(0, 0, 260, 240))
    np.testing.assert_array_equal(labels, np.where(alpha[..., 0] >= 0.5, third["id"], 0))


def _by_id(entries):
    return sorted(entries, key=lambda entry: entry["id"])


def test_what_is_wrong_is_said(palette, tmp_path):
    _, facts, table = palette
    stray = painted(disc(), facts["labels"])
    oiio.ImageBufAlgo.render_box(stray, 100, 100, 140, 140, (1, 0, 1), True)
    with pytest.raises(
        errors.ImageError,
        match=r"farther than 0.2 in Oklab from every color of the table.: 255,0,255"
        r" \(\d+ samples, first at 1\d\d,1\d\d\)",
    ):
        filters.paint(photo(), stray, palette=table, patch=16)
    fine = painted(disc(inner=3, outer=0), facts["finer"])
    oiio.ImageBufAlgo.render_box(fine, 100, 100, 110, 110, (1, 0, 1), True)
    with pytest.raises(errors.ImageError, match=r"fine painting.*: 255,0,255 .*100,100"):
        filters.paint(photo(), ids_buffer(disc()), fine=fine, palette=table, patch=16)
    with pytest.raises(errors.ParameterError, match="fine contains colors"):
        filters.paint(photo(), ids_buffer(disc()), fine=fine, patch=16)
    with pytest.raises(errors.ParameterError, match=r"fine: requires label\.0"):
        filters.paint(photo(), ids_buffer(disc()), fine=ids_buffer(disc()), labellevel=1, patch=16)
    (tmp_path / "bad.json").write_text('{"labels": 3}')
    with refused(errors.ImageError, parameter="palette", value=str(tmp_path / "bad.json")):
        filters.paint(photo(), stray, palette=tmp_path / "bad.json")
    facts["labels"][0]["id"] = 9
    (tmp_path / "more.json").write_text(json.dumps(facts))
    with pytest.raises(errors.ImageError, match=r"palette=.*more\.json.*: .*\[9, 9\]"):
        filters.paint(photo(), stray, palette=tmp_path / "more.json")
    filters.paint(photo(), ids_buffer(disc()), patch=16, planfile=tmp_path / "a.npz")
    with refused(errors.ImageError, parameter="fromplan", value=str(tmp_path / "a.npz")) as caught:
        filters.paint(photo(), ids_buffer(disc()), size=(100, 90), fromplan=tmp_path / "a.npz")
    assert caught.value.problem.startswith("260x240 px") and caught.value.expected.startswith("100x90 px")
    with np.load(tmp_path / "a.npz") as arrays:
        np.savez(tmp_path / "cut.npz", **{**arrays, "guide": arrays["guide"][..., :1]})
    with refused(errors.ImageError, parameter="fromplan", expected="a plan of filters.paint"):
        filters.paint(photo(), ids_buffer(disc()), fromplan=tmp_path / "cut.npz")
    filters.quilt(photo(), patch=16, planfile=tmp_path / "q.npz")
    with refused(errors.ImageError, parameter="fromplan", expected="a plan of filters.paint"):
        filters.paint(photo(), ids_buffer(disc()), fromplan=tmp_path / "q.npz")
    with pytest.raises(errors.ImageError, match="no label parts"):
        filters.paint(buffer(PHOTO), ids_buffer(disc()))
    with refused(errors.ImageError, task="a palette of 160x160", budget=1 << 20):
        filters.palette(photo(), session=Session(budget=1 << 20))


@pytest.mark.slow
def test_from_photo_to_painting_on_the_command_line(tmp_path):
    save(PHOTO, tmp_path / "photo.png")
    lines = [
        ("photo.png", "--iscolorspace", "sRGB", "--texlabel:photo=1", "-o", "labeled.exr"),
        ("labeled.exr", "--texpalette:facts=p.json:panel=32", "-o", "palette.exr"),
    ]
    for line in lines:
        done = oiiotex(*line, cwd=tmp_path)
        assert done.returncode == 0, done.stderr
    facts = json.loads((tmp_path / "p.json").read_text())
    first, second = (facts["labels"][n]["color"] for n in (0, -1))
    painting = np.array([[int(n) / 255 for n in c.split(",")] for c in (first, second)])
    save(painting[(disc() > 1).astype(int)], tmp_path / "painting.png")
    line = ("labeled.exr", "painting.png", "--texpaint:palette=p.json:patch=16:planfile=plan.npz", "-o")
    found = []
    for more, name in (((), "a.exr"), (("--threads", "1", "--cache", "600"), "b.exr")):
        done = oiiotex(*line, name, *more, cwd=tmp_path)
        assert done.returncode == 0, done.stderr
        found.append(load(tmp_path / name))
    assert found[0].shape == (240, 260, 3) and (tmp_path / "plan.npz").is_file()
    np.testing.assert_array_equal(*found)


# --- one texture over another ---


def test_layers_are_cut_in_a_band_and_any_window_is_the_whole_cropped():
    lab = (pictures.pebbles(60, 70, 3) * 400).astype(np.int16)
    whole = Window(0, 0, 300, 280)
    mask = disc(280, 300, 1, 0) > 0
    y, x = np.ogrid[:280, :300]
    above = SourceMap.of(y % 60, x % 70)
    below = SourceMap.of((y + 17) % 60, (x + 31) % 70)
    laid = np.where(mask, above.packed, below.packed)

    def made() -> seam_overlay.SeamOverlay:
        return seam_overlay.SeamOverlay(
            lab, lambda w: below[w.inside(whole)], lambda w: (mask[w.inside(whole)], above[w.inside(whole)]), whole, 8
        )

    found = made().sources(whole, PieceCache(1 << 24)).packed
    for window in (Window(3, 5, 140, 200), Window(127, 100, 129, 280), Window(200, 250, 300, 280)):
        np.testing.assert_array_equal(made().sources(window, PieceCache(1 << 24)).packed, found[window.inside(whole)])
    y, x = np.indices(mask.shape)
    away = np.abs(np.hypot(y - 120, x - 130) - 80)
    np.testing.assert_array_equal(found[away > 12], laid[away > 12])
    assert (found != laid).any()  # the cut strays from the mask, to where it is cheaper

    def cost(packed: np.ndarray) -> int:
        places = np.stack(SourceMap(packed).yx)
        near = away < 14
        right, down = seam_costs(SeamPhoto(lab), places, np.ones(mask.shape, bool))
        return int(right[near[:, 1:]].sum() + down[near[1:]].sum())

    assert cost(found) < cost(laid)


@pytest.mark.parametrize("value", [False, True])
def test_a_mask_without_a_border_is_no_cut(value):
    lab, whole = np.zeros((9, 9, 3), np.int16), Window(0, 0, 130, 20)
    below, above = (SourceMap(np.full((20, 130), n, np.uint32)) for n in (0, 1))
    laid = seam_overlay.SeamOverlay(
        lab, lambda w: below[w.inside(whole)], lambda w: (np.full((w.height, w.width), value), above[w.inside(whole)]),
        whole, 4,
    )  # fmt: skip
    assert (laid.sources(whole, PieceCache(1 << 20)).packed == int(value)).all()
