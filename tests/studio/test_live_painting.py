# SPDX-License-Identifier: Apache-2.0
"""A painting's layers and its steps on disk: what is kept, and within which box two steps may differ."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest
from oiiotex_studio.live.painting.palette import (
    COARSE,
    FINE,
    LAYERS,
    LabelPalette,
    extended,
    require_replaceable,
    step_facts,
)
from oiiotex_studio.live.painting.plans import changed_box
from oiiotex_studio.live.painting.steps import Steps, fine_of, paintings_in

from oiiotex import filters
from oiiotex.engine.core.piece_cache import PieceCache
from oiiotex.engine.errors import ImageError
from oiiotex.engine.io.reading import read
from tests.conftest import save
from tests.faults import full_disk
from tests.synthesis import test_painting
from tests.synthesis.test_labelgrowth import ids_buffer

CACHE = PieceCache(1 << 24)
TABLE = {
    "labels": [{"id": 7, "name": "moss", "color": "0,204,255"}, {"id": 2, "name": "stone", "color": "230,26,0"}],
    "finer": [
        {"id": 300, "name": "label.1/300", "color": "0,204,255", "parents": [7], "box": [0, 0, 8, 8]},
        {"id": 301, "name": "label.1/301", "color": "9,9,9", "parents": [7]},  # it has no swatch
        {"id": 5, "name": "label.1/5", "color": "77,77,128", "parents": [2, 7], "box": [8, 0, 8, 8]},
    ],
}


@pytest.fixture
def palette() -> LabelPalette:
    return LabelPalette(TABLE, np.zeros((8, 16, 3), np.float32), np.array([[7, 2], [0, 2]], np.uint32))


def layers() -> dict[str, np.ndarray]:
    coarse = np.full((64, 96), 7, np.uint8)
    coarse[:, 4:] = 2
    return {COARSE: coarse, FINE: np.zeros_like(coarse)}


def test_finer_labels_are_numbered_where_they_have_a_swatch_and_stay_inside_their_own(palette):
    assert [(one["number"], one["id"]) for one in palette.finer] == [(1, 300), (2, 5)]
    assert palette.allows(FINE, np.array([[0, 1, 2]])) and not palette.allows(FINE, np.array([[3]]))
    assert palette.allows(COARSE, np.array([[2, 7]])) and not palette.allows(COARSE, np.array([[0]]))
    painting = layers()
    painting[FINE][2:4], painting[FINE][6] = 1, 2
    palette.keep_inside(painting, (slice(0, 7), slice(0, 96)))
    wanted = np.zeros((64, 96), np.uint8)
    wanted[2:4, :4], wanted[6] = 1, 2  # the second lies in both coarse labels
    np.testing.assert_array_equal(painting[FINE], wanted)


def test_a_new_painting_is_the_photos_own_labels_mirrored_to_its_size(palette):
    wanted = [[7, 2, 2, 7, 7], [7, 2, 2, 7, 7], [7, 2, 2, 7, 7]]  # 0, without a swatch, is the first label
    np.testing.assert_array_equal(palette.photo(5, 3), wanted)


def test_layers_are_read_back_and_say_what_they_are_of(palette, tmp_path):
    painting = layers()
    painting[FINE][1, :4], painting[FINE][3, 4:] = 1, 2
    files = {layer: tmp_path / f"{layer}.png" for layer in painting}
    palette.write_layers(files, painting, {"seed": 7, "change": "Stroke \u00e9"})
    np.testing.assert_equal(palette.read_layers(files, CACHE), painting)
    legend = json.loads(oiio.ImageBuf(str(files[FINE])).spec()["oiiotex:legend"])
    assert legend == {
        "1": {"name": "label.1/300", "color": "0,204,255"}, "2": {"name": "label.1/5", "color": "77,77,128"},
    }  # fmt: skip
    assert step_facts(files[COARSE], CACHE) == {"seed": 7, "change": "Stroke \u00e9"}
    for facts in ({"seed": -1}, {"seed": True}, {"seed": 1 << 32}, {"seed": 1, "change": "x" * 1000}, {"change": 1}):
        palette.write_layers({COARSE: tmp_path / "broken.png"}, painting, facts)
        with pytest.raises(ImageError, match=r"broken\.png: invalid oiiotex:step: expected seed, an integer"):
            step_facts(tmp_path / "broken.png", PieceCache(1 << 24))


def test_paintings_from_elsewhere_are_ids_or_colors(palette, tmp_path):
    painting = layers()
    painting[FINE][1, :4] = 1
    ids = save(painting[COARSE][..., None], tmp_path / "ids.exr", "float")
    finer = np.where(painting[FINE] > 0, 300, 0)[..., None]
    assert fine_of(ids) == save(finer, tmp_path / "ids.fine.exr", "uint32")
    np.testing.assert_equal(palette.read_layers({COARSE: ids, FINE: fine_of(ids)}, CACHE), painting)
    colors = np.where(painting[COARSE][..., None] == 7, (0, 204, 255), (230, 26, 0)) / 255
    colors[0, 0] += 0.02  # a soft brush
    soft = save(colors, tmp_path / "soft.tif", "uint16")
    found = palette.read_layers({COARSE: soft, FINE: fine_of(soft)}, CACHE)
    np.testing.assert_equal(found, {COARSE: painting[COARSE], FINE: np.zeros_like(painting[FINE])})


@pytest.mark.parametrize(
    ("pixels", "legend", "said"),
    [
        (np.full((64, 64, 1), 3), "", "ids without a label: 3 (4096 px, first at 0,0)"),
        (np.full((64, 64, 1), np.nan), "", "ids without a label: -1 (4096 px, first at 0,0)"),
        (np.full((64, 64, 1), 1e30), "", f"ids without a label: {2**53} (4096 px, first at 0,0)"),
        (np.full((64, 64, 3), 0.5), "", "colors without a label"),
        (np.full((64, 32, 1), 7), "", "has 32x64 px: expected 64 to 4096 px per side"),
        (np.full((4, 4097, 1), 7), "", "has 4097x4 px"),
        (np.full((64, 64, 1), 7), '{"1": {"name": "leaf", "color": "0,204,255"}}', "with leaf: expected moss"),
        (np.full((64, 64, 1), 7), "[" * 5000, "its legend cannot be read"),
    ],
    ids=("ids", "NaN", "far", "colors", "small", "large", "legend", "deep"),
)
def test_what_is_no_painting_of_this_photo_is_refused_in_words(palette, tmp_path, pixels, legend, said):
    path = save(pixels, tmp_path / "other.tif", "float")
    image = read(path, CACHE)
    if legend:
        image.first.spec.attribute("oiiotex:legend", legend)
        with pytest.raises(ImageError, match=re.escape(said)):
            palette.read(COARSE, image)
        return
    with pytest.raises(ImageError, match=re.escape(said)):
        palette.read_layers({COARSE: path, FINE: fine_of(path)}, CACHE)


def test_pictures_beside_are_offered_and_links_are_not(tmp_path):
    for name in ("b.png", "a.EXR", "a.fine.exr", "notes.txt"):
        (tmp_path / name).touch()
    (tmp_path / "folder.png").mkdir()
    (tmp_path / "link.png").symlink_to("/etc/passwd")
    assert list(paintings_in([tmp_path, tmp_path, tmp_path / "none"])) == [f"{tmp_path}/a.EXR", f"{tmp_path}/b.png"]


def plan(path: Path, coarse: np.ndarray, fine: np.ndarray | None = None, side: int = 640) -> None:
    """A step's plan, of patches of 32 px every 24 that show nothing but where they lie."""
    arrays = {}
    for prefix, offsets in (("", coarse), ("fine_", fine)):
        if offsets is not None:
            cuts = np.zeros((*offsets.shape, 32), np.uint8)
            arrays |= {f"{prefix}facts": np.array([1, side, side, 32, 8, 0, 0, 99, 99]), f"{prefix}offsets": offsets}
            arrays |= {f"{prefix}vertical": cuts, f"{prefix}horizontal": cuts}
    np.savez(path, **arrays)


def test_two_steps_differ_within_a_box_of_what_is_painted_anew(tmp_path):
    nothing = np.zeros((640, 640), np.uint8)
    cells = np.zeros((27, 27), np.uint32)
    other = cells.copy()
    other[4, 5:7] = 1
    plan(tmp_path / "0.npz", cells)
    plan(tmp_path / "1.npz", other)

    def box(before: int, after: int, fine: tuple) -> tuple | None:
        return changed_box(tmp_path / f"{before}.npz", tmp_path / f"{after}.npz", fine, 1 << 26)

    assert box(0, 1, (nothing, nothing)) == (5 * 24 - 32, 4 * 24 - 32, 7 * 24 + 32, 5 * 24 + 32)
    assert box(0, 0, (nothing, nothing)).empty
    # the first of a fine layer: the tiles of 128 px around it that a cut within 32 px of it may change
    fine = nothing.copy()
    fine[300:330, 400:420] = 1
    plan(tmp_path / "2.npz", cells, cells)
    assert box(0, 2, (nothing, fine)) == (256, 256, 512, 384)
    # another patch of the fine layer shows where that is painted, and nowhere else
    far, near = cells.copy(), cells.copy()
    far[2, 2], near[13, 17] = 1, 1
    plan(tmp_path / "3.npz", cells, far)
    assert box(2, 3, (fine, fine)).empty
    plan(tmp_path / "4.npz", cells, near)
    assert box(2, 4, (fine, fine)) == (256, 256, 512, 384)
    plan(tmp_path / "5.npz", cells, side=320)
    assert box(0, 5, (nothing, nothing)) is None


@pytest.fixture
def spare(tmp_path) -> Path:
    path = tmp_path / "spare"
    path.mkdir()
    return path


def make(steps: Steps, *, fine: bool = False, text: str = "") -> int:
    """A step whose files say which it is."""
    step = steps.start()
    for path in (steps.picture(step), steps.plan(step), *([steps.fine(step)] if fine else [])):
        path.write_text(text or str(step))
    return step


def test_looks_at_a_stroke_are_joined_and_take_their_fine_layers_with_them(tmp_path, spare):
    steps = Steps(tmp_path / "photo.paint", spare)
    make(steps)
    steps.save()
    looks = [make(steps, fine=True), make(steps, text="the last"), make(steps, fine=True), make(steps, text="the last")]
    assert steps.join(looks) == 1 and steps.numbers == [0, 1] and steps.last == 1
    steps.save()
    assert [path.name for path in sorted(steps.folder.iterdir())] == [
        "000000.npz", "000000.png", "000001.npz", "000001.png",
    ]  # fmt: skip
    assert steps.picture(1).read_text() == steps.plan(1).read_text() == "the last"
    assert not list(spare.iterdir())


def test_a_history_takes_no_file_away_and_none_ones_place(tmp_path, spare):
    steps = Steps(tmp_path / "photo.paint", spare)
    steps.folder.mkdir()
    for name in ("mine.png", "000000.png", "000000.npz", "000000.fine.png", "000004.txt", "000001.png"):
        (steps.folder / name).write_text(f"the user's {name}")
    before = {path.name: path.read_text() for path in steps.folder.iterdir()}
    assert steps.numbers == [0] and make(steps, fine=True) == 5 and make(steps) == 6
    steps.forget(0)  # not one that was just started
    steps.forget(6)
    steps.save()
    after = {path.name: path.read_text() for path in steps.folder.iterdir()}
    assert after == before | {"000005.png": "5", "000005.npz": "5", "000005.fine.png": "5"}
    assert steps.numbers == [0, 5]


def test_a_link_is_no_folder_of_steps(tmp_path, spare):
    outside = tmp_path / "outside"
    outside.mkdir()
    for name in ("000000.png", "000000.npz"):
        (outside / name).write_text("")
    linked = Steps(tmp_path / "linked.paint", spare)
    linked.folder.symlink_to(outside)
    assert linked.last == -1
    make(linked)
    with pytest.raises(ImageError, match=r"linked\.paint must be a folder, for the steps"):
        linked.save()
    assert len(list(outside.iterdir())) == 2 and linked.numbers == [0]


def test_steps_that_the_disk_does_not_take_are_kept_and_saved_later(tmp_path, spare, monkeypatch):
    steps = Steps(tmp_path / "photo.paint", spare)
    make(steps)
    steps.save()
    for _ in range(2):
        make(steps, fine=True)
    with monkeypatch.context() as patch:
        full_disk(patch)
        with pytest.raises(ImageError, match=r"photo\.paint/000001\.png: No space left on device"):
            steps.save()
    assert steps.unsaved and steps.numbers == [0, 1, 2] and steps.picture(2).read_text() == "2"
    again = Steps(steps.folder, spare)  # a server that was killed then, and started again
    assert again.numbers == [0, 1, 2] and make(again) == 3
    again.save()
    assert not again.unsaved and not list(spare.iterdir()) and len(list(again.folder.iterdir())) == 10
    # others were saved meanwhile: those in memory come after them
    for name in ("000001.png", "000001.npz"):
        (spare / name).write_text("late")
    late = Steps(steps.folder, spare)
    assert late.numbers == [0, 1, 2, 3, 4] and late.picture(4).read_text() == "late"


def test_a_canvas_is_cut_off_or_extended_by_its_commonest_label():
    painting = layers()
    painting[FINE][:3, :2] = 1
    larger = extended(painting, 100, 70)
    assert larger[COARSE].shape == larger[FINE].shape == (70, 100)
    for layer in LAYERS:
        np.testing.assert_array_equal(larger[layer][:64, :96], painting[layer])
    assert (larger[COARSE][64:] == 2).all() and (larger[COARSE][:, 96:] == 2).all() and not larger[FINE][:, 2:].any()
    for layer, plane in extended(painting, 80, 90).items():
        np.testing.assert_array_equal(plane[:64], painting[layer][:, :80])


def test_a_canvas_of_another_size_keeps_its_patches(tmp_path, spare):
    coarse = np.full((160, 200), 1)
    coarse[:, 120:] = 2
    steps, photo = Steps(tmp_path, spare), test_painting.photo()

    def painted(ids: np.ndarray, name: str, **more: object) -> np.ndarray:
        return filters.paint(photo, ids_buffer(ids), planfile=tmp_path / name, **more).get_pixels(oiio.FLOAT)

    shown = painted(coarse, "000000.npz", patch=16)
    larger = np.full((200, 260), 1)
    larger[:160, :200] = coarse
    around = painted(larger, "larger.npz", fromplan=steps.resized(0, (260, 200), 1 << 26))
    np.testing.assert_array_equal(around[:128, :168], shown[:128, :168])  # as far as two patches from the old border
    assert (around[:160, :200] == shown).mean() > 0.9
    anew = painted(larger, "anew.npz", patch=16, seed=0)
    assert (anew[:128, :168] != shown[:128, :168]).any()
    smaller = painted(coarse[:100, :90], "smaller.npz", fromplan=steps.resized(0, (90, 100), 1 << 26))
    np.testing.assert_array_equal(smaller[:68, :58], shown[:68, :58])


def test_a_table_takes_no_other_files_place(tmp_path):
    table = tmp_path / "photo.palette.json"
    require_replaceable(table)
    table.write_text(json.dumps(TABLE))
    require_replaceable(table)
    (tmp_path / "linked.json").symlink_to(table)
    for path, text in ((table, '{"mine": 1}'), (table, "no JSON"), (table, "[]"), (tmp_path / "linked.json", "")):
        if text:
            path.write_text(text)
        with pytest.raises(ImageError, match=f"{path.name} is not a palette's table and would be overwritten"):
            require_replaceable(path)


def test_a_painting_many_times_larger_is_sewn_around_the_patches_that_are_shown(tmp_path, spare):
    coarse = np.full((160, 200), 1)
    coarse[:, 120:] = 2
    fine = np.zeros_like(coarse)
    fine[40:120, 30:110] = 2
    steps, photo = Steps(tmp_path, spare), test_painting.photo()

    def painted(name: str, **more: object) -> np.ndarray:
        path = tmp_path / name
        filters.paint(photo, ids_buffer(coarse), fine=ids_buffer(fine), planfile=path, **more)
        return np.load(path)

    shown = painted("000000.npz", patch=16)
    before = steps.enlarged(0, 3, 1 << 26)
    around, anew = (painted(f"{n}.npz", size=(600, 480), **more) for n, more in enumerate(({"fromplan": before}, {})))
    for layer in ("", "fine_"):
        small = shown[f"{layer}offsets"]
        assert (around[f"{layer}facts"][3:5] == shown[f"{layer}facts"][3:5]).all()  # patch and overlap
        rows, columns = small.shape
        corners = around[f"{layer}offsets"][::3, ::3][:rows, :columns]
        same = corners == small
        demanded = (around[f"{layer}keys"][::3, ::3][:rows, :columns] == shown[f"{layer}keys"]) & (
            around[f"{layer}guide"][::3, ::3][:rows, :columns] == shown[f"{layer}guide"]
        ).all((2, 3))
        assert same[demanded].all() and demanded.mean() > 0.6
    assert (anew["offsets"][::3, ::3][: len(small), : small.shape[1]] == shown["offsets"]).mean() < 0.1
