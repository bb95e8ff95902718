# SPDX-License-Identifier: Apache-2.0
"""Label maps grown from found ones, and --texcomposite, which fills them."""

from __future__ import annotations

import logging

import numpy as np
import OpenImageIO as oiio
import pytest

from oiiotex import filters
from oiiotex.engine import errors
from oiiotex.engine.core.window import Domain
from oiiotex.engine.session import Session
from oiiotex.synthesis.quilting import label_growth as lg
from tests import pictures
from tests.any_filter import buffer, pixels
from tests.conftest import load, oiiotex, save
from tests.refusals import refused


def blobs(height: int = 160, width: int = 192, seed: int = 0) -> np.ndarray:
    """Labels 1, 2 and 3; the 3rd lies only within the 2nd."""
    field = pictures.smooth_noise(height, width, 32, seed)
    low, high = np.quantile(field, (0.55, 0.85))
    return (1 + (field > low) + (field > high)).astype(np.uint32)


def ids_buffer(ids: np.ndarray) -> oiio.ImageBuf:
    made = oiio.ImageBuf(oiio.ImageSpec(ids.shape[1], ids.shape[0], 1, oiio.UINT32))
    made.set_pixels(made.roi, np.ascontiguousarray(ids.astype(np.uint32))[..., None])
    return made


def grow(device, ids: np.ndarray, size=(500, 400), wrap=(False, False), seed=0, side=4, **more) -> lg.Grown:
    return lg.grow_labels(device, ids, side, Domain(*size, *wrap), seed, 1 << 30, lambda *_: None, **more)


def test_a_cell_holds_its_most_frequent_label():
    ids = np.array([[1, 1, 2, 2, 9], [1, 3, 2, 1, 9], [5, 5, 0, 0, 9], [4, 4, 0, 6, 9]])
    assert lg.cells_of(ids, 2).tolist() == [[1, 2], [4, 0]]  # ties go to the lower label
    assert lg.cell_side(96.8, 640, 640) == 24 and lg.cell_side(7, 4000, 4000) == 21 and lg.cell_side(0, 64, 64) == 1


@pytest.mark.parametrize("count", [1, 2, 8, 9, 100])
def test_labels_become_colors_that_lie_apart(count):
    found = lg.apart(count)
    assert found.shape == (count, 3) and found.min() >= 0 and found.max() <= 100
    distance = np.linalg.norm(found[:, None] - found[None], axis=-1) + 1e9 * np.eye(count)
    assert distance.min() >= 0.5 * 100 / np.ceil(count ** (1 / 3))


def test_shares_and_neighborhoods_are_kept(device):
    ids = blobs(seed=1)
    made = grow(device, ids, seed=1)
    assert made.ids.shape == (100, 125) and set(np.unique(made.ids)) <= {1, 2, 3}
    found, grown = ([np.mean(m == k) for k in (1, 2, 3)] for m in (ids, made.ids))
    assert np.abs(np.subtract(found, grown)).sum() / 2 < 0.15
    assert made.shares < 0.15 and made.neighbors < 0.15
    right = np.stack([made.ids[:, :-1].ravel(), made.ids[:, 1:].ravel()])
    below = np.stack([made.ids[:-1].ravel(), made.ids[1:].ravel()])
    pairs = np.sort(np.concatenate([right, below], 1), 0)
    touching = np.mean((pairs[0] == 1) & (pairs[1] == 3))
    assert touching < 0.01  # what never lies side by side does hardly ever: a shuffled map has 0.2 of them
    shuffled = np.random.default_rng(0).permuted(made.ids.ravel()).reshape(made.ids.shape)
    assert lg._away(*(lg._pairs(m.astype(int), np.ones(m.shape, bool), 4) for m in (made.ids, shuffled))) > 0.3


def test_the_figures_are_the_distances_of_the_statistics():
    index = np.array([[0, 0, 1], [0, 1, 1]])
    ok = np.ones(index.shape, bool)
    assert lg._shares(index, ok, 2).tolist() == [0.5, 0.5]
    assert (lg._pairs(index, ok, 2) * 7).round().tolist() == [2, 3, 0, 2]
    assert lg._away(np.array([0.5, 0.5]), np.array([0.2, 0.8])) == pytest.approx(0.3)


def test_of_several_starts_the_best_is_taken(device):
    ids = blobs(seed=5)
    sums = [made.shares + made.neighbors for made in (grow(device, ids, tries=n) for n in (1, 3))]
    assert sums == sorted(sums, reverse=True)


def test_the_same_seed_grows_the_same_map(device, narrow_device):
    once, again, narrow, other = (
        grow(d, blobs(), seed=s, tries=1).ids for d, s in ((device, 1), (device, 1), (narrow_device, 1), (device, 2))
    )
    np.testing.assert_array_equal(once, again)
    np.testing.assert_array_equal(once, narrow)
    assert (once != other).mean() > 0.2


def test_a_torus_closes(device):
    """Labels go on across the border of a torus, and are another map's where there is none."""

    def across(wraps: bool) -> float:
        maps = [grow(device, blobs(), wrap=(wraps, wraps), seed=seed, tries=1).ids for seed in range(4)]
        return float(np.mean([np.mean(m[0] != m[-1]) + np.mean(m[:, 0] != m[:, -1]) for m in maps]))

    assert across(True) < 0.6 * across(False)


def test_what_has_no_label_does_not_grow(device):
    ids = blobs()
    ids[40:80, 30:150] = 0
    assert (grow(device, ids).ids > 0).all()
    with pytest.raises(errors.ImageError, match="no labels to grow"):
        grow(device, np.zeros((80, 80), np.uint32))
    specks = np.zeros((160, 160), np.uint32)
    specks[::32, ::32] = 1
    with pytest.raises(errors.ImageError, match="too small to grow from"):
        grow(device, specks, side=1)


# --- --texcomposite ---

LABELS = blobs(seed=2)
PHOTO = np.array([[0.1, 0.4, 0.1], [0.5, 0.3, 0.2], [0.8, 0.8, 0.9]])[LABELS.astype(int) - 1]
PHOTO = np.clip(PHOTO + 0.15 * (pictures.pebbles(160, 192, 3) - 0.5), 0, 1)


def test_a_composite_is_filled_as_it_was_grown(caplog):
    with caplog.at_level(logging.INFO, "oiiotex"):
        made = filters.composite(
            {"photo": buffer(PHOTO), "label.1": ids_buffer(LABELS)},
            size=(300, 260),
            patch=16,
            grown=True,
            labelmaps=True,
        )
    assert list(made) == ["composite", "label.1", "grown"]
    wanted, filled = pixels(made["grown"])[..., 0], pixels(made["label.1"])[..., 0]
    assert wanted.shape == filled.shape == (260, 300) and pixels(made["composite"]).shape == (260, 300, 3)
    inside = np.ones(wanted.shape, bool)  # away from borders
    for shift in (-8, 8):
        inside &= (np.roll(wanted, shift, 0) == wanted) & (np.roll(wanted, shift, 1) == wanted)
    assert inside.mean() > 0.2 and (filled == wanted)[inside].mean() > 0.9
    assert any("grown to" in r.getMessage() and "errors: proportions" in r.getMessage() for r in caplog.records)


def test_a_composite_is_a_quilt_of_its_own_grown_map():
    photo = {"photo": buffer(PHOTO), "label.1": ids_buffer(LABELS)}
    made = filters.composite(photo, size=(300, 200), patch=16, grown=True, seed=3)
    quilt = filters.quilt(photo, guide=made["grown"], size=(300, 200), patch=16, seed=3)
    np.testing.assert_array_equal(pixels(made["composite"]), pixels(quilt))


@pytest.mark.slow
def test_one_command_from_a_photo(tmp_path):
    save(PHOTO, tmp_path / "photo.png")
    line = (
        "photo.png",
        "--iscolorspace",
        "sRGB",
        "--texlabel:photo=1",
        "--texcomposite:size=300x260:tiles=xy:patch=16",
    )
    found = []
    for name, more in (("a.exr", ()), ("b.exr", ("--threads", "1", "--cache", "600"))):
        done = oiiotex(*line, *more, "-o", name, cwd=tmp_path)
        assert done.returncode == 0, done.stderr
        found.append(load(tmp_path / name))
    assert found[0].shape == (260, 300, 3)
    np.testing.assert_array_equal(*found)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ((), "no label parts"),
        (("--texlabel:photo=1", ":labellevel=99"), "labellevel=99: expected one of"),
        (("--texlabel:photo=1", ":size=4194304x4194304"), "quilting 4194304x4194304"),
    ],
)
def test_what_is_wrong_is_said(fails, tmp_path, words, said):
    save(PHOTO, tmp_path / "wrong.png")
    labeling = words[:1]
    line = fails("wrong.png", "--iscolorspace", "sRGB", *labeling, "--texcomposite" + "".join(words[1:]))
    assert said in line


def test_a_grown_map_too_large_for_the_budget_is_refused():
    photo = {"photo": buffer(PHOTO), "label.1": ids_buffer(LABELS)}
    with refused(errors.ImageError, budget=8 << 20):
        filters.composite(photo, size=(40000, 40000), session=Session(budget=8 << 20))
