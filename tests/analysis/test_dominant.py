# SPDX-License-Identifier: Apache-2.0
"""The dominant texture: masks against known outliers, and bad input."""

from __future__ import annotations

import functools
import json

import numpy as np
import OpenImageIO as oiio
import pytest

from benchmarks.dominant.composites import composite, mask_by, seen_as
from oiiotex import filters
from oiiotex.analysis.dominant import diffusion
from oiiotex.analysis.dominant.diffusion import dominant_texture
from oiiotex.analysis.dominant.refinement import pixel_colors, refined_mask
from oiiotex.engine import errors
from oiiotex.engine.core.image import from_buffer
from oiiotex.engine.session import Session
from oiiotex.engine.session.progress import Progress
from tests import pictures
from tests.analysis.test_labels import buffer
from tests.conftest import load, oiiotex, save
from tests.refusals import refused

DRAWN = (0, 2, 3, 4)  # composites that need no photos


def mask_of(picture: np.ndarray, names: tuple[str, ...] = (), **values: object) -> np.ndarray:
    made = filters.dominant(buffer(picture, names), **values)
    return made.get_pixels(oiio.FLOAT)[..., 0]


@functools.cache
def composite_mask(n: int) -> np.ndarray:
    """Of one composite, at the filter's defaults."""
    return mask_of(composite(n)[1])


def test_outliers_are_left_out():
    ious, precisions = [], []
    for n in DRAWN:
        truth = composite(n)[2]
        mask = composite_mask(n) > 0
        ious.append((mask & truth).sum() / (mask | truth).sum())
        precisions.append((mask & truth).sum() / mask.sum())
    assert np.mean(ious) > 0.9 and min(ious) > 0.8 and np.mean(precisions) > 0.93


def test_a_wider_step_of_texels_agrees():
    same = []
    for n in DRAWN[:1]:
        _, picture, _ = composite(n)
        same.append((composite_mask(n) == mask_by(from_buffer(buffer(picture, ())), "diffusion", step=2)).mean())
    assert np.mean(same) > 0.9


def test_a_clean_texture_is_nearly_all_dominant():
    assert mask_of(pictures.moss(94, 125, 3)).mean() > 0.9


def test_parts_attributes_and_json(tmp_path):
    _, picture, truth = composite(0)
    save(picture, tmp_path / "wall.png")
    words = "--texdominant:photo=1:score=1:facts=facts.json"
    done = oiiotex("wall.png", words, "-d", "float", "-o", "all.exr", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    specs = [oiio.ImageBuf(str(tmp_path / "all.exr"), n, 0).spec() for n in range(3)]
    assert [s.get_string_attribute("oiio:subimagename") for s in specs[1:]] == ["dominant", "score"]
    mask, score = (load(tmp_path / "all.exr", n) for n in (1, 2))
    assert set(np.unique(mask)) == {0, 1} and score.shape[2] == 2
    facts = json.loads((tmp_path / "facts.json").read_text())
    assert facts["patch"] == specs[1].get_int_attribute("oiiotex:patch")
    assert facts["share"] == pytest.approx(specs[1].get_float_attribute("oiiotex:share"))
    assert len(facts["types"]) == 4
    assert sum(facts["types"]) == facts["texels"] and facts["rounds"] and len(facts["curve"]) > 50


def test_a_quilt_from_the_mask_takes_no_other_pixel(tmp_path):
    """The issue's command: the photo and its mask in one image, straight into the synthesis."""
    save(composite(3)[1], tmp_path / "wall.png")
    chain = ("--texdominant:photo=1", "--texquilt:mask=dominant:flattening=0:size=160x120:patch=16:st=1")
    done = oiiotex("wall.png", "-d", "float", chain[0], "-o", "parts.exr", chain[1], "-o", "clean.exr", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    mask, clean, st = load(tmp_path / "parts.exr", 1), load(tmp_path / "clean.exr", 0), load(tmp_path / "clean.exr", 1)
    assert clean.shape == (120, 160, 3) and 0.3 < mask.mean() < 0.9
    column, row = ((st[..., n] * size).astype(int) for n, size in ((0, 125), (1, 94)))
    assert (mask[row, column] == 1).all()
    photo = load(tmp_path / "wall.png").astype(np.float64)
    assert len(np.unique(row * 125 + column)) > 1000
    assert np.abs(photo[row, column] / 255 - clean).max() < 1e-3


def test_a_rejected_photo_cannot_be_quilted(tmp_path):
    save(np.random.default_rng(0).random((60, 60, 3)), tmp_path / "noise.png")
    chain = ("--texdominant:photo=1", "--texquilt:mask=dominant:size=64x64")
    done = oiiotex("noise.png", *chain, "-o", "clean.exr", cwd=tmp_path)
    warning, error = done.stderr.strip().splitlines()
    assert done.returncode == 1 and "noise.png has no dominant texture" in warning
    assert error.startswith("oiiotex ERROR: --texquilt") and "mask selects no pixel of noise.png" in error
    assert not (tmp_path / "clean.exr").exists()


def test_a_normalized_cut_parts_two_textures():
    """One that fills 70 % of the picture and one of other colors: the larger half is the first, but for a border."""
    picture = pictures.moss(60, 80, 3)
    picture[:, 56:] = [0.8, 0.3, 0.1] * (0.5 + 0.5 * picture[:, 56:, 1:2])
    mask = mask_by(from_buffer(buffer(picture, ())), "spectral", step=2, patch=5)
    assert mask[:, :52].mean() > 0.95 and mask[:, 60:].mean() < 0.05


# --- bad input ---


def test_noise_is_rejected_with_a_warning_and_an_empty_mask(caplog):
    noise = np.random.default_rng(0).random((80, 90, 3))
    assert mask_of(noise).max() == 0
    assert "no dominant texture" in caplog.text


def test_a_plain_image_is_all_dominant():
    assert mask_of(np.full((40, 50, 3), 0.4)).min() == 1


def test_images_smaller_than_the_patch():
    for shape in ((1, 1, 3), (2, 9, 3), (4, 4, 3), (1, 60, 3)):
        assert mask_of(np.random.default_rng(0).random(shape)).shape == shape[:2]
    with refused(errors.ImageError, parameter="patch", value=15, problem="exceeds ImageBuf, 9x8"):
        mask_of(np.zeros((8, 9, 3)), patch=15)


def test_holes_in_alpha_are_never_in_the_mask():
    _, picture, _ = composite(3)
    alpha = np.ones((*picture.shape[:2], 1))
    alpha[50:70, 60:100] = 0
    alpha[::9, ::23] = 0  # pinholes
    mask = mask_of(np.concatenate([picture * alpha, alpha], -1), tuple("RGBA"))
    assert mask[alpha[..., 0] == 0].max() == 0 and mask.mean() > 0.3
    assert mask_of(np.zeros((30, 30, 4)), tuple("RGBA")).max() == 0


def test_a_mask_with_holes_says_where_to_look():
    _, picture, _ = composite(3)
    mask = np.ones((*picture.shape[:2], 1))
    mask[50:70, 60:100] = mask[::9, ::23] = 0
    found = mask_of(picture, mask=buffer(mask, ("Y",)))
    assert found[mask[..., 0] == 0].max() == 0
    alpha = mask_of(np.concatenate([picture * mask, mask], -1), tuple("RGBA"))
    np.testing.assert_array_equal(found, alpha)  # as holes in alpha
    with pytest.raises(errors.ImageError, match="mask selects no pixel"):
        mask_of(picture, mask=buffer(0 * mask, ("Y",)))
    with pytest.raises(errors.ImageError, match=r"mask .*8x8.* 125x94"):
        mask_of(picture, mask=buffer(mask[:8, :8], ("Y",)))


def test_pictures_seen_directly_are_those_of_the_filter():
    _, picture, _ = composite(0)
    pixels = seen_as(picture, Session())
    found = diffusion.dominant_texture(pixels, Session().resources, Progress())
    np.testing.assert_array_equal(refined_mask(found, pixels, pixel_colors(pixels)), composite_mask(0) > 0)


def test_a_mask_follows_pixels_better_than_dilated_patches():
    _, picture, truth = composite(DRAWN[1], 1)
    pixels = seen_as(picture, Session())
    found = diffusion.dominant_texture(pixels, Session().resources, Progress())
    masks = diffusion.dominant_mask(found, pixels.seen), refined_mask(found, pixels, pixel_colors(pixels))
    dilated, refined = ((mask & truth).sum() / (mask | truth).sum() for mask in masks)
    assert refined > dilated


def test_paper_is_ldr09_by_the_letter():
    with refused(
        errors.ParameterError, parameter="preset", value="clean", problem="conflicts with paper=1", expected="no preset"
    ):
        filters.op_named("stationarize")(exemplar=None, paper=True, preset="clean")
    # figure 6: diffusion tells dirt from a weave, Euclidean distances do not (of most composites the letter keeps all)
    _, picture, truth = composite(10, 0)
    pixels, overlap = seen_as(picture, Session()), {}
    for mode in ("diffusion", "euclidean"):
        found = dominant_texture(pixels, Session().resources, Progress(), rule="paper", step=1, mode=mode)
        mask = diffusion.dominant_mask(found, pixels.seen)
        overlap[mode] = (mask & truth).sum() / (mask | truth).sum()
    assert overlap["diffusion"] > 0.85 > overlap["euclidean"], overlap
    noise = seen_as(np.random.default_rng(0).random((40, 40, 3)), Session())
    assert "noise" in dominant_texture(noise, Session().resources, Progress()).rejected
    assert "noise" not in dominant_texture(noise, Session().resources, Progress(), rule="paper", step=1).rejected
