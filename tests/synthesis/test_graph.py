# SPDX-License-Identifier: Apache-2.0
"""--texgraph: graphs from photos, which --texsynth takes at once, and graphs as pictures."""

from __future__ import annotations

import json

import numpy as np
import OpenImageIO as oiio
import pytest

from oiiotex import filters
from oiiotex.engine import errors
from oiiotex.filters import texgraph
from oiiotex.synthesis.multiscale.graph import Edge, read_graph
from tests import pictures
from tests.conftest import load, oiiotex, run_in, save
from tests.refusals import refused

SRGB = "srgb_rec709_scene"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    made = tmp_path_factory.mktemp("graph")
    save(pictures.pebbles(150, 170, 1), made / "pebbles.png", space=SRGB)
    save(pictures.moss(64, 64, 2), made / "moss.png", space=SRGB)
    save(pictures.bricks(64, 80, 3), made / "bricks.png", space=SRGB)
    save(pictures.moss(20, 20, 3), made / "small.png", space=SRGB)
    save(pictures.moss(64, 64, 2)[..., :1], made / "gray.png", space=SRGB)
    (made / "sub").mkdir()
    return made


def takes(folder, graph):
    run_in(folder, "--autocc", f"--texsynth:graph={graph}:size=40x30:exemplarside=32", "-o", "taken.png")
    assert load(folder / "taken.png").std() > 5


@pytest.mark.slow
def test_photos_become_a_chain_that_is_synthesized_at_once(folder):
    photos = ("moss.png", "bricks.png", "pebbles.png")
    run_in(folder, *photos, "--texgraph:graphfile=sub/chain.json:ratio=4,3", "-o", "chain.png")
    graph = read_graph(folder / "sub" / "chain.json")
    assert graph.names == ("moss", "bricks", "pebbles") and graph.root == 0
    assert graph.edges == (Edge(0, 1, 2), Edge(1, 2, 2)) and graph.factors == pytest.approx((1, 1, 4 / 3))
    assert all(file.is_file() for file in graph.files)
    takes(folder, "sub/chain.json")
    run_in(folder, "small.png", "small.png", "--texgraph:graphfile=small.json", "-o", "small_graph.png")
    assert read_graph(folder / "small.json").edges == (Edge(0, 1, 1),)  # r_max = L - 3
    done = run_in(folder, "moss.png", "moss.png", "--texgraph:graphfile=twice.json:loop=1", "-o", "twice.png")
    assert "no ratio given: assuming that each photo is 8 times finer" in done.stderr
    graph = read_graph(folder / "twice.json")
    assert graph.names == ("moss", "moss-2") and graph.edges == (Edge(0, 1, 3), Edge(1, 1, 1))


def test_one_photo_gets_an_edge_to_itself(folder):
    for more, r in ((":loop=3", 3), ("", 1)):
        run_in(folder, "moss.png", f"--texgraph:graphfile=loop.json{more}", "-o", "loop.png")
        assert read_graph(folder / "loop.json").edges == (Edge(0, 0, r),)
    takes(folder, "loop.json")


def test_a_chain_is_cut_from_one_photo(folder):
    run_in(folder, "pebbles.png", "--texgraph:graphfile=cut.json:scales=3", "-o", "cut.png")
    graph = read_graph(folder / "cut.json")
    assert [file.name for file in graph.files] == ["cut_4.png", "cut_2.png", "cut_1.png"]
    assert graph.edges == (Edge(0, 1, 1), Edge(1, 2, 1))
    photo = load(folder / "pebbles.png").astype(np.float64)
    for factor in (4, 2, 1):
        wide = 32 * factor
        y, x = (150 - wide) // 2, (170 - wide) // 2
        square = photo[y : y + wide, x : x + wide].reshape(32, factor, 32, factor, 3).mean((1, 3))
        np.testing.assert_allclose(load(folder / f"cut_{factor}.png"), square, atol=0.51)
    takes(folder, "cut.json")


def test_the_picture_shows_exemplars_by_their_octaves(folder, monkeypatch):
    monkeypatch.setattr(texgraph, "PANEL", 64)
    graph = {"exemplars": [{"id": n, "file": f"{n}.png"} for n in ("moss", "bricks", "pebbles")]}
    graph["edges"] = [{"from": "moss", "to": n, "r": 2} for n in ("bricks", "pebbles")]
    graph["edges"].append({"from": "pebbles", "to": "pebbles", "r": 1})
    (folder / "tree.json").write_text(json.dumps(graph))
    picture = filters.graph(draw=folder / "tree.json", exemplarside=64).get_pixels(oiio.UINT8)
    first, second = 24, 24 + 64 + 72  # columns: the root's, and that of both others
    for name, x, y in (("moss", first, 46), ("bricks", second, 46), ("pebbles", second, 46 + 64 + 56 + 32)):
        held = load(folder / f"{name}.png")
        top, left = (held.shape[0] - 64) // 2, (held.shape[1] - 64) // 2
        shown = picture[y : y + 64, x : x + 64].astype(int)
        assert np.abs(shown - held[top : top + 64, left : left + 64]).max() <= 1, name
    drawn = (picture.max(-1) < 100).sum()
    graph["edges"].pop()
    (folder / "tree.json").write_text(json.dumps(graph))
    fewer = filters.graph(draw=folder / "tree.json", exemplarside=64).get_pixels(oiio.UINT8)
    assert drawn - (fewer.max(-1) < 100).sum() > 100  # the loop's arrow


def photo(folder, name):
    return oiio.ImageBuf(str(folder / name))


WRONG = [
    (("moss", "gray"), {}, "gray.png has channels Y: expected R,G,B, as .*moss.png"),
    (("moss", "bricks"), {"ratio": (2, 3, 4)}, "ratio=.2.0, 3.0, 4.0.: expected one number, or one for each edge .1."),
    (("moss", "bricks"), {"scales": 2}, "scales=2: expected one photo, not 2"),
    (("moss",), {"scales": 4}, "scales=4: reduces .*moss.png to 8 px: expected at least 16 px"),
    (("moss",), {"scales": 2, "ratio": 3}, "ratio=.3.0,.: expected one power of two >= 2, with scales"),
    (("moss",), {"loop": 5}, r"edge moss -> moss: r=5 is more than r_max = L - 3 = 3 of exemplars"),
    (("small",), {"draw": "none.json"}, "graph: takes 0 images"),
    ((), {"draw": "none.json"}, "none.json: No such file"),
    ((), {}, r"graph: takes one image or more \(photos\), not 0"),
]


@pytest.mark.parametrize("names, values, message", WRONG, ids=[m[:30] for *_, m in WRONG])
def test_what_is_wrong_is_said(folder, names, values, message):
    values = {k: folder / v if k in ("json", "graph") else v for k, v in values.items()}
    with pytest.raises(errors.Error, match=message):
        filters.graph(*(photo(folder, f"{name}.png") for name in names), **values)


def test_a_graph_names_files_that_hold_what_was_seen(folder):
    done = oiiotex("moss.png", "--mulc", "0.5", "--texgraph:graphfile=never.json", "-o", "never.png", cwd=folder)
    assert done.returncode == 1 and "moss.png differs from its file, which the graph names" in done.stderr
    with refused(errors.ImageError, subject="ImageBuf"):
        filters.graph(oiio.ImageBufAlgo.resize(photo(folder, "moss.png"), roi=oiio.ROI(0, 32, 0, 32)),
                      graphfile=folder / "never.json")  # fmt: skip
    assert not (folder / "never.json").exists()
