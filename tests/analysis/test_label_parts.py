# SPDX-License-Identifier: Apache-2.0
"""What a label map is on disk and in a host: parts, attributes, trees, Cryptomattes, and the view of it."""

from __future__ import annotations

import itertools
import json
import subprocess
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest
from scipy.ndimage import maximum_filter, minimum_filter

from oiiotex import filters
from oiiotex.analysis.labels.scales import LabelSettings, label_maps
from oiiotex.engine import errors
from oiiotex.engine.color.lab import lens_of
from oiiotex.engine.core.image import Image, from_buffer, from_pixels
from oiiotex.engine.core.label_map import LabelMap
from oiiotex.engine.io.cryptomatte import cryptomatte_part, hashed, hashes
from oiiotex.engine.session import Session
from oiiotex.engine.session.progress import Progress
from tests.analysis.test_labels import NOISE, buffer, quarters
from tests.conftest import made_by, oiiotex, save
from tests.peer import OIIOTOOL
from tests.refusals import refused


@pytest.fixture(scope="module")
def written(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("labels")
    save(quarters(128)[0], folder / "photo.png")
    words = "--texlabel:photo=1:membership=1:cryptomatte=manifest.json:facts=tree.json"
    done = oiiotex("photo.png", words, "-o", "a.exr", cwd=folder)
    assert done.returncode == 0, done.stderr
    return folder


def parts_of(path: Path) -> dict[str, oiio.ImageBuf]:
    found = {}
    for n in range(oiio.ImageBuf(str(path)).nsubimages):
        part = oiio.ImageBuf(str(path), n, 0)
        found[part.spec().get_string_attribute("oiio:subimagename") or str(n)] = part
    return found


def ids_of(part: oiio.ImageBuf) -> np.ndarray:
    return part.get_pixels(oiio.UINT32)[..., 0]


def parents_of(part: oiio.ImageBuf) -> list[list[int]]:
    return [[int(n) for n in some.split() if n != "0"] for some in part.spec()["oiiotex:parents"].split(",")]


def test_every_level_is_a_part_of_ids_that_says_what_it_is(written):
    parts = parts_of(written / "a.exr")
    tree = json.loads((written / "tree.json").read_text())["levels"]
    labels = [p for name, p in parts.items() if name.startswith("label.")]
    assert len(labels) == len(tree) > 1
    for part, facts in zip(labels, tree, strict=True):
        ids = ids_of(part)
        assert part.spec().format == oiio.UINT32
        assert part.spec().get_int_attribute("oiiotex:labels") == len(facts["labels"]) == ids.max()
        assert part.spec().get_float_attribute("oiiotex:rho") == pytest.approx(facts["rho"])
        assert parents_of(part) == [f["parents"] for f in facts["labels"]]
        np.testing.assert_array_equal(np.bincount(ids.ravel())[1:], [f["pixels"] for f in facts["labels"]])
    for fine, coarse in itertools.pairwise(labels):
        parents = parents_of(fine)
        pairs = np.unique(np.stack([ids_of(fine).ravel(), ids_of(coarse).ravel()]), axis=1)
        assert all(above in parents[label - 1] for label, above in pairs.T.tolist())


def test_soft_parts_are_memberships_and_fits(written):
    parts = parts_of(written / "a.exr")
    membership, fit = (parts[f"{name}.1"].get_pixels(oiio.FLOAT) for name in ("membership", "fit"))
    np.testing.assert_allclose(membership.sum(-1), 1, atol=1e-5)
    assert membership.shape == fit.shape and fit.min() >= 0
    np.testing.assert_allclose(fit.max((0, 1)), 1, atol=1e-5)


def test_tiff_holds_the_labels_and_png_is_refused_as_a_further_part(written):
    done = oiiotex("photo.png", "--texlabel", "-o", "a.tif", cwd=written)
    assert done.returncode == 0, done.stderr
    np.testing.assert_array_equal(
        ids_of(oiio.ImageBuf(str(written / "a.tif"))), ids_of(parts_of(written / "a.exr")["label.1"])
    )
    done = oiiotex("photo.png", "--texlabel:photo=1", "-o", "a.png", cwd=written)
    assert done.returncode == 1 and "label.1" in done.stderr


def test_hashes_are_those_of_the_specification():
    assert hashed("hello") == 0x248BFA47
    for n in range(3000):
        assert (hashed(f"label.1/{n}") >> 23) & 255 not in (0, 255)


def test_names_of_equal_hash_are_told_apart(monkeypatch):
    monkeypatch.setattr("oiiotex.engine.io.cryptomatte.hashed", lambda name: 0x40000000 + len(name) % 3)
    bits = hashes(["x", "y"])
    assert len(bits) == len(set(bits.values())) == 2


def test_oiiotool_reads_the_cryptomatte(written):
    part = parts_of(written / "a.exr")["cryptomatte"]
    ids = ids_of(parts_of(written / "a.exr")["label.1"])
    count = int(ids.max())
    manifest = json.loads((written / "manifest.json").read_text())
    assert len([n for n in manifest if n.startswith("label.1/")]) == count
    pixels = part.get_pixels(oiio.FLOAT)
    expected = np.array([0] + [int(manifest[f"label.1/{n}"], 16) for n in range(1, count + 1)], np.uint32)
    inside = maximum_filter(ids, 3) == minimum_filter(ids, 3)  # borders are soft
    seen = np.ascontiguousarray(pixels[..., 0]).view(np.uint32)
    np.testing.assert_array_equal(seen[inside], expected[ids][inside])
    np.testing.assert_array_equal(pixels[..., 1][inside], 1)
    np.testing.assert_allclose(pixels[..., 1] + pixels[..., 3], 1, atol=1e-6)
    number = list(parts_of(written / "a.exr")).index("cryptomatte")
    words = ["a.exr", "--subimage", str(number), "--cryptomatte-colors", "label1_", "-o", "colors.exr"]
    done = subprocess.run([OIIOTOOL, *words], cwd=written, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    colors = oiio.ImageBuf(str(written / "colors.exr")).get_pixels(oiio.FLOAT)[..., :3][inside]
    pairs = np.unique(np.concatenate([colors, ids[inside].reshape(-1, 1)], 1), axis=0)
    assert len(pairs) == len(np.unique(ids[inside])) == len(np.unique(colors, axis=0)) > 2


def test_a_cryptomatte_says_its_manifest():
    spec = oiio.ImageSpec(2, 1, 1, oiio.UINT32)
    part = from_pixels("label.1", np.array([[[0], [1]]], np.uint32), spec)
    made, manifest = cryptomatte_part([LabelMap.of(part, 1, [()])])
    texts = {a.name.rpartition("/")[2]: a.value for a in made.spec.extra_attribs if a.name.startswith("cryptomatte/")}
    assert texts["hash"] == "MurmurHash3_32" and texts["conversion"] == "uint32_to_float32"
    assert json.loads(texts["manifest"]) == manifest == {"label.1/1": f"{hashed('label.1/1'):08x}"}
    assert (made.read(made.window)[0, 0] == 0).all()


def test_in_python_parts_go_by_their_names():
    photo = buffer(quarters(96)[0])
    found = filters.label(photo, photo=True)
    assert next(iter(found)) != "label.1" and "label.1" in found
    assert found["label.1"].spec().format == oiio.UINT32
    assert next(iter(filters.label(photo))) == "label.1"


def test_memory_that_is_not_there_is_named():
    with refused(errors.ImageError, task="labeling"):
        image, session = from_buffer(buffer(quarters(256)[0])), Session()
        lens = lens_of(image, session.resources)
        label_maps(image, lens, session.resources, session.progress, settings=LabelSettings(neighbors=10**9))


def test_a_run_can_be_stopped_and_says_how_far_it_is():
    image, steps = from_buffer(buffer(quarters(96)[0])), []
    session = Session(progress=lambda done, total: steps.append((done, total)))
    label_maps(image, lens_of(image, session.resources), session.resources, session.progress)
    assert steps == sorted(steps) and steps[-1][0] == steps[-1][1]
    with pytest.raises(errors.Interrupted):
        label_maps(image, lens_of(image, session.resources), session.resources, Progress(lambda done, total: False))


def test_the_view_shows_photo_levels_and_tree(written):
    done = oiiotex("a.exr", "--texlabelview", "-o", "view.png", cwd=written)
    assert done.returncode == 0, done.stderr
    view = oiio.ImageBuf(str(written / "view.png"))
    assert view.spec().nchannels == 3 and view.spec().width > 3 * 128
    assert len(np.unique(view.get_pixels(oiio.UINT8).reshape(-1, 3), axis=0)) > 100


def test_colors_stay_apart_for_every_eye():
    from oiiotex.analysis.labels.legend import _BLIND, _oklab, distinct_colors

    srgb = distinct_colors()[:12]
    linear = np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
    for eye in (np.eye(3), *np.array(_BLIND)):
        seen = _oklab(np.clip(linear @ eye.T, 0, 1))
        apart = np.sqrt(((seen[:, None] - seen) ** 2).sum(-1)) + np.eye(12)
        assert apart.min() > 0.06  # 0.02 is just noticeable


def test_the_view_wants_labels():
    with pytest.raises(errors.ImageError, match=r"filters\.label or filters\.superpixel"):
        filters.labelview(buffer(NOISE))
    spec = oiio.ImageSpec(3, 2, 1, oiio.UINT32)
    part = from_pixels("label.1", np.arange(6, dtype=np.uint32).reshape(2, 3, 1), spec)
    assert made_by(filters.op_named("labelview")(source=Image((part,))))["view"].any()
