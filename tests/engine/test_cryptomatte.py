# SPDX-License-Identifier: Apache-2.0
"""What --texlabel:cryptomatte= writes, as other programs find it; Blender's word is in test_cryptomatte_blender."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest
from scipy.ndimage import convolve, maximum_filter, minimum_filter

from oiiotex.engine.core.image import Part, from_pixels
from oiiotex.engine.core.window import Window
from oiiotex.engine.io.cryptomatte import covered, hashed
from tests.analysis.test_label_parts import ids_of, parts_of
from tests.analysis.test_labels import quarters
from tests.conftest import load, oiiotex, save
from tests.peer import OIIOTOOL

UNNAMED = ["--subimage", "cryptomatte", "--eraseattrib", "name", "--eraseattrib", "oiio:subimagename"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """Labels of a picture with a hole: the manifest within all.exr, and beside apart.exr."""
    made = tmp_path_factory.mktemp("cryptomatte")
    alpha = np.ones((96, 96, 1))
    alpha[20:50, 30:70] = 0
    save(np.concatenate([quarters(96)[0] * alpha, alpha], -1), made / "photo.png")
    (made / "sub").mkdir()
    for choice, out in (("1", "all.exr"), ("sub/names.json", "sub/apart.exr")):
        done = oiiotex("photo.png", f"--texlabel:photo=1:cryptomatte={choice}", "-o", out, cwd=made)
        assert done.returncode == 0, done.stderr
    return made


def facts_of(path: Path) -> dict[str, dict[str, str]]:
    """By layer what the metadata say of it."""
    attributes = parts_of(path)["cryptomatte"].spec().extra_attribs
    found: dict[str, dict[str, str]] = {}
    for a in attributes:
        if a.name.startswith("cryptomatte/"):
            _, key, name = a.name.split("/")
            found.setdefault(key, {})[name] = a.value
    return {facts["name"]: facts for facts in found.values()}


def test_a_manifest_beside_the_image_is_named_as_seen_from_it(folder):
    within, apart = facts_of(folder / "all.exr"), facts_of(folder / "sub" / "apart.exr")
    assert set(within) == set(apart)
    assert all("manifest" in f and "manif_file" not in f for f in within.values())
    assert all(f["manif_file"] == "names.json" and "manifest" not in f for f in apart.values())
    beside = json.loads((folder / "sub" / "names.json").read_text())
    joint = {name: bits for f in within.values() for name, bits in json.loads(f["manifest"]).items()}
    assert beside == joint


def test_the_manifest_has_every_label_and_no_other(folder):
    labels = {n: p for n, p in parts_of(folder / "all.exr").items() if n.startswith("label.")}
    layers = facts_of(folder / "all.exr")
    assert len(layers) == len(labels) > 1
    for n, part in enumerate(labels.values(), 1):
        manifest = json.loads(layers[f"label{n}_"]["manifest"])
        assert manifest == {
            f"label.{n}/{i}": f"{hashed(f'label.{n}/{i}'):08x}" for i in range(1, ids_of(part).max() + 1)
        }


@pytest.mark.parametrize("file", ["all.exr", "sub/apart.exr"])
def test_oiiotool_colors_every_layer_by_its_labels(folder, file):
    parts = parts_of(folder / file)
    number = str(list(parts).index("cryptomatte"))
    for name in (n for n in parts if n.startswith("label.")):
        layer = f"label{name.removeprefix('label.')}_"
        words = [OIIOTOOL, file, "--subimage", number, "--cryptomatte-colors", layer, "-o", "colors.exr"]
        done = subprocess.run(words, cwd=folder, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stdout + done.stderr
        ids, colors = ids_of(parts[name]), load(folder / "colors.exr")[..., :3]
        assert (ids == 0).any() and not colors[ids == 0].any()  # the hole has no coverage
        inside = maximum_filter(ids, 3) == minimum_filter(ids, 3)  # borders are soft
        ids, colors = ids[inside], colors[inside]
        pairs = np.unique(np.concatenate([colors.reshape(-1, 3), ids.reshape(-1, 1)], 1), axis=0)
        assert len(pairs) == len(np.unique(ids)) == len(np.unique(pairs[:, :3], axis=0)) > 2


def test_the_part_is_found_by_its_name_and_says_nothing_of_one_level(folder):
    """Also before it was written."""
    for words in (["all.exr"], ["photo.png", "--texlabel:photo=1:cryptomatte=1"]):
        done = oiiotex(*words, "--subimage", "cryptomatte", "-o", "alone.exr", cwd=folder)
        assert done.returncode == 0, done.stderr
        spec = oiio.ImageBuf(str(folder / "alone.exr")).spec()
        assert spec.channelnames[:4] == tuple(f"label1_00.{c}" for c in "RGBA")
        assert spec.getattribute("oiiotex:rho") is None and spec.getattribute("oiiotex:parents") is None


def test_superpixels_are_found_by_their_name(folder):
    words = ["photo.png", "--texsuperpixel:count=40:photo=1", "--subimage", "superpixels", "-o", "cells.exr"]
    done = oiiotex(*words, cwd=folder)
    assert done.returncode == 0, done.stderr
    assert load(folder / "cells.exr").dtype == np.uint32


def test_the_cryptomatte_alone_and_nameless_is_the_same_from_a_file_and_at_once(folder):
    """As Blender wants it: it finds layers by names that begin channels, and puts a part's name before those."""
    for words in (
        ["photo.png", "--texlabel:cryptomatte=1", *UNNAMED, "-o", "once.exr"],
        ["all.exr", *UNNAMED, "-o", "picks.exr"],
    ):
        done = oiiotex(*words, cwd=folder)
        assert done.returncode == 0, done.stderr
    np.testing.assert_array_equal(load(folder / "once.exr"), load(folder / "picks.exr"))
    specs = [oiio.ImageBuf(str(folder / name)).spec() for name in ("once.exr", "picks.exr")]
    facts = [{a.name: a.value for a in s.extra_attribs if a.name.startswith("cryptomatte/")} for s in specs]
    assert facts[0] == facts[1] and len(facts[0]) == 4 * (specs[0].nchannels // 4)
    assert not any(s.get_string_attribute("oiio:subimagename") for s in specs)


# --- soft borders ---


def labels_of(ids: np.ndarray) -> Part:
    """A label part of these ids, whose window is off the origin."""
    spec = oiio.ImageSpec(ids.shape[1], ids.shape[0], 1, oiio.UINT32)
    spec.x, spec.y = 5, -3
    return from_pixels("label.1", ids[..., None].astype(np.uint32), spec)


def test_coverage_is_what_a_binomial_filter_of_every_label_says():
    ids = np.random.default_rng(0).integers(0, 4, (17, 23))
    part = labels_of(ids)
    kernel = np.outer([1, 2, 1], [1, 2, 1])
    weight = np.stack([convolve((ids == label).astype(np.int64), kernel, mode="nearest") for label in range(4)], -1)
    weight[..., 0] = 0
    found, shares = covered(part, part.window)
    for y, x in np.ndindex(ids.shape):
        if ids[y, x] == 0:
            assert not shares[y, x].any()
            continue
        ordered = sorted(weight[y, x], reverse=True)[:2]
        np.testing.assert_allclose(shares[y, x], np.array(ordered) / sum(ordered), rtol=1e-6)
        for rank in range(2):
            if shares[y, x, rank] > 0:
                assert weight[y, x, found[y, x, rank]] == ordered[rank]
        assert found[y, x, 0] != found[y, x, 1]
        if weight[y, x, ids[y, x]] == ordered[0]:
            assert found[y, x, 0] == ids[y, x]


def test_a_straight_border_is_soft_over_two_pixels_and_shares_add_up():
    found, shares = covered(labels_of(np.repeat([[1, 1, 1, 2, 2, 2]], 5, 0)), Window.sized(5, -3, 6, 5))
    cover = [np.where(found == label, shares, 0).sum(-1)[2].tolist() for label in (1, 2)]
    assert cover == [[1, 1, 0.75, 0.25, 0, 0], [0, 0, 0.25, 0.75, 1, 1]]
    np.testing.assert_array_equal(shares.sum(-1), 1)


def test_a_window_is_the_whole_cropped():
    ids = np.random.default_rng(1).integers(0, 5, (20, 30)) // 2
    part = labels_of(ids)
    whole = covered(part, part.window)
    for window in (Window.sized(5, -3, 1, 1), Window.sized(11, 2, 9, 7), Window.sized(30, 10, 5, 7)):
        for all_of_it, cut in zip(whole, covered(part, window), strict=True):
            np.testing.assert_array_equal(cut, all_of_it[window.inside(part.window)])


# --- one part ---


@pytest.mark.parametrize("op", ["label", "decompose"])
def test_a_single_part_holds_the_photo_and_its_cryptomatte(folder, op):
    done = oiiotex("photo.png", f"--tex{op}:cryptomatte=1:onepart=1", "-o", "single.exr", cwd=folder)
    assert (done.returncode, done.stderr) == (0, "")
    parts = list(parts_of(folder / "single.exr"))
    assert len(parts) == 1
    buffer = oiio.ImageBuf(str(folder / "single.exr"))
    spec = buffer.spec()
    assert spec.channelnames[:4] == ("R", "G", "B", "A") and spec.alpha_channel == 3
    assert spec.channelnames[4:8] == tuple(f"label1_00.{c}" for c in "RGBA")
    assert not spec.get_string_attribute("oiio:subimagename") and not spec.get_string_attribute("name")
    pixels = buffer.get_pixels(oiio.FLOAT)
    np.testing.assert_allclose(pixels[..., :4], load(folder / "photo.png") / 255, atol=1e-6)
    np.testing.assert_allclose(pixels[..., 5] + pixels[..., 7], pixels[..., 3] > 0, atol=1e-6)
    facts = [a for a in spec.extra_attribs if a.name.startswith("cryptomatte/") and a.name.endswith("/manifest")]
    assert len(facts) == (spec.nchannels - 4) // 4


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("onepart=1", "onepart=1: requires cryptomatte=1"),
        ("onepart=1:cryptomatte=1:photo=1", "conflicts with photo:"),
        ("onepart=1:cryptomatte=1:photo=1:membership=1", "conflicts with photo, membership:"),
    ],
)
def test_what_does_not_go_with_a_single_part_is_refused(folder, words, said):
    done = oiiotex("photo.png", f"--texlabel:{words}", "-o", "no.exr", cwd=folder)
    assert done.returncode == 1 and said in done.stderr and not (folder / "no.exr").exists()
