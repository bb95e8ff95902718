# SPDX-License-Identifier: Apache-2.0
"""What is said of an exemplar graph before it is used, and exemplars of different spaces, types and channels."""

from __future__ import annotations

import json

import numpy as np
import OpenImageIO as oiio
import pytest

from oiiotex.engine.core.op import Space
from oiiotex.engine.session import Session
from oiiotex.synthesis.multiscale.candidate_sets import analyze
from oiiotex.synthesis.multiscale.coverage import FAR, shares, unmatched
from oiiotex.synthesis.multiscale.infinite_plane import graph_images
from oiiotex.synthesis.multiscale.stacks import load_exemplars
from oiiotex.synthesis.multiscale.targets import stacks_of
from tests import pictures
from tests.conftest import load, oiiotex, save
from tests.synthesis.test_candidates import BUDGET, exemplar_of, graph_of

SRGB = "srgb_rec709_scene"


def analyzed(device, graph, *made):
    stacks = stacks_of(graph, [exemplar_of(picture, periodic=False) for picture in made])
    return analyze(device, stacks, 16, True, BUDGET, lambda done, total: None, None)


def test_shares_say_who_is_taken(device):
    """Of two exemplars that could follow, the one that is like the root is taken, the other nowhere."""
    moss = pictures.moss(32, 32, 1) * 0.5 + 0.2
    graph = graph_of("abc", ("a", "b", 1), ("a", "c", 1))
    found = dict(shares(graph, analyzed(device, graph, moss, moss, 1 - 0.2 * moss)))
    assert set(found) == {1, 2}
    assert found[1] > 0.2 and found[2] == 0


def test_what_nothing_finer_is_like_is_found(device):
    """The right half is dark, and nothing dark follows."""
    root = 0.6 + 0.1 * np.random.default_rng(1).random((64, 64, 1)) * np.ones(3)
    root[:, 32:] -= 0.5
    graph = graph_of("ab", ("a", "b", 1))
    bright = 0.6 + 0.1 * np.random.default_rng(2).random((64, 64, 1)) * np.ones(3)
    (found,) = unmatched(analyzed(device, graph, root, bright))
    assert found.exemplar == 0 and found.share == pytest.approx(0.5, abs=0.05)
    assert found.x >= 32 and found.away == pytest.approx(50 * 3**0.5, abs=6)
    (found,) = unmatched(analyzed(device, graph, bright, root))
    assert found.share == 0 and found.away < FAR
    assert unmatched(analyzed(device, graph_of("a", ("a", "a", 1)), root)) == ()  # it goes on to itself


def drawn(folder, edges, **more):
    names = sorted({end for edge in edges for end in edge[:2]})
    document = {
        "exemplars": [{"id": n, "file": f"{n}.exr", **more.get(n, {})} for n in names],
        "root": "root",
        "edges": [{"from": a, "to": b, "r": r} for a, b, r in edges],
    }
    (folder / "g.json").write_text(json.dumps(document))


def run(folder, *words):
    done = oiiotex("-v", "--autocc", *words, cwd=folder)
    assert done.returncode == 0, done.stderr
    return done.stderr


@pytest.mark.slow
def test_the_program_warns(tmp_path):
    moss = pictures.moss(64, 64, 1) * 0.5 + 0.2
    save(moss, tmp_path / "root.exr", space=SRGB)
    save(moss, tmp_path / "like.exr", space=SRGB)
    save(np.ones(3) - 0.1 * moss, tmp_path / "white.exr", space=SRGB)
    drawn(tmp_path, [("root", "like", 1), ("root", "white", 1)])
    said = run(tmp_path, "--texsynth:graph=g.json:size=32x32", "-o", "a.exr")
    assert "exemplar 'white' appears nowhere: others match better (it is a candidate for 0 % of the texels" in said
    assert "no finer match" not in said and "'like' is a candidate for" in said
    drawn(tmp_path, [("root", "white", 1)])
    said = run(tmp_path, "--texsynth:graph=g.json:size=32x32", "-o", "a.exr")
    assert "exemplar 'root': 100 % of it has no finer match" in said and "appears nowhere" not in said


@pytest.mark.slow
def test_an_exemplar_may_say_what_is_at_its_borders(tmp_path):
    save(np.linspace(0, 1, 64)[:, None, None] * np.ones((64, 64, 3)), tmp_path / "root.exr", space=SRGB)
    outcomes = {}
    for wrap in (None, "mirror", "periodic"):
        drawn(tmp_path, [("root", "root", 1)], root={} if wrap is None else {"wrap": wrap})
        run(tmp_path, "--texsynth:graph=g.json:size=64x64:lod=6", "-o", "a.exr")
        outcomes[wrap] = load(tmp_path / "a.exr")
    np.testing.assert_array_equal(outcomes[None], outcomes["mirror"])
    assert (outcomes["periodic"] != outcomes["mirror"]).any()
    drawn(tmp_path, [("root", "root", 1)], root={"wrap": "clamp"})
    done = oiiotex("--autocc", "--texsynth:graph=g.json", "-o", "b.exr", cwd=tmp_path)
    assert done.returncode == 1 and "exemplars[0].wrap: expected 'periodic' or 'mirror', not 'clamp'" in done.stderr


def test_exemplars_of_other_spaces_are_brought_to_the_roots(tmp_path):
    """One picture in two encodings is one exemplar: its Lab values, and its pixels in the root's space."""
    picture = pictures.moss(64, 64, 3)
    linear = np.where(picture <= 0.04045, picture / 12.92, ((picture + 0.055) / 1.055) ** 2.4)
    save(picture, tmp_path / "root.exr", space=SRGB)
    save(linear, tmp_path / "fine.exr", space="lin_rec709_scene")
    drawn(tmp_path, [("root", "fine", 1)])
    resources = Session().resources
    graph, images = graph_images(tmp_path / "g.json", resources)
    (root, fine), lens = load_exemplars(images, graph, resources, Space.LAB, 64)
    np.testing.assert_allclose(fine.values[..., :3], root.values[..., :3], atol=0.2)
    np.testing.assert_allclose(fine.pixels.astype(np.float32), root.pixels.astype(np.float32), atol=2e-3)
    assert np.abs(linear - picture).max() > 0.1 and "srgb" in str(lens.space).lower()
    run(tmp_path, "--texsynth:graph=g.json:size=64x64", "-o", "a.exr")
    assert oiio.ImageBuf(str(tmp_path / "a.exr")).spec().get_string_attribute("oiio:ColorSpace") == SRGB
    assert load(tmp_path / "a.exr").mean() == pytest.approx(picture.mean(), abs=0.05)


@pytest.mark.slow
def test_bytes_and_halfs_may_be_mixed_and_gray_and_color_may_not(tmp_path):
    save(pictures.moss(32, 32, 1), tmp_path / "bytes.png", space=SRGB)
    half = oiio.ImageBuf(oiio.ImageSpec(32, 32, 3, oiio.HALF))
    half.set_pixels(half.roi, pictures.moss(32, 32, 2).astype(np.float32))
    half.specmod().attribute("oiio:ColorSpace", SRGB)
    half.write(str(tmp_path / "half.exr"))
    save(pictures.moss(32, 32, 1)[..., :1], tmp_path / "gray.png", space=SRGB)
    for first, second, kind in (("bytes.png", "half.exr", "tif"), ("half.exr", "bytes.png", "exr")):
        nodes = [{"id": n, "file": n} for n in (first, second)]
        edges = [{"from": first, "to": second, "r": 1}]
        (tmp_path / "g.json").write_text(json.dumps({"exemplars": nodes, "edges": edges}))
        run(tmp_path, "--texsynth:graph=g.json:size=40x40", "-o", f"a.{kind}")
        spec = oiio.ImageBuf(str(tmp_path / f"a.{kind}")).spec()
        assert spec.format == (oiio.UINT8 if kind == "tif" else oiio.HALF) and spec.nchannels == 3
    nodes = [{"id": n, "file": n} for n in ("gray.png", "half.exr")]
    edges = [{"from": "gray.png", "to": "half.exr", "r": 1}]
    (tmp_path / "g.json").write_text(json.dumps({"exemplars": nodes, "edges": edges}))
    done = oiiotex("--autocc", "--texsynth:graph=g.json", "-o", "b.exr", cwd=tmp_path)
    assert done.returncode == 1 and len(done.stderr.strip().splitlines()) == 1
    said = done.stderr.replace(str(tmp_path) + "/", "")
    assert "half.exr has channels R,G,B: expected Y, the channels of the root gray.png" in said
