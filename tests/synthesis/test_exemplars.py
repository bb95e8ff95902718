# SPDX-License-Identifier: Apache-2.0
"""Exemplar graphs: what a document says, and what exactly is wrong with it."""

from __future__ import annotations

import json
import math
import sys
import types
from pathlib import Path

import pytest

from oiiotex.engine.errors import ImageError
from oiiotex.synthesis.multiscale.graph import Edge, Graph, parse_graph, read_graph
from tests.conftest import data_folder


def document(edges=(), names="abc", **more):
    return {"exemplars": [{"id": n, "file": f"{n}.png"} for n in names], "edges": list(edges), **more}


def edge(source, destination, **relation):
    return {"from": source, "to": destination, **relation}


CHAIN = (edge("a", "b", r=2), edge("b", "c", r=1))


def parsed(found):
    return parse_graph(found, Path("maps/g.json"))


def test_a_document_says_exemplars_root_edges_jitter_and_seed():
    graph = parsed(document(CHAIN, jitter=[0, 0.5], seed=9))
    assert graph.names == ("a", "b", "c") and graph.root == 0
    assert graph.files[1] == Path("maps/b.png")
    assert graph.edges == (Edge(0, 1, 2), Edge(1, 2, 1))
    assert (graph.jitter, graph.seed, graph.factors) == ((0.0, 0.5), 9, (1.0, 1.0, 1.0))
    assert graph.depth() == 3


def test_loops_are_kept_and_do_not_hide_the_root():
    graph = parsed(document([edge("a", "b", r=1), edge("b", "b", r=2), edge("a", "a", r=0)], "ab"))
    assert graph.edges == (Edge(0, 1, 1), Edge(1, 1, 2))  # r = 0 to itself is implied
    assert graph.in_loop(1) and not graph.in_loop(0)
    assert graph.leads_on(0) and graph.depth() == 1
    longer = parsed(document([edge("a", "b", r=1), edge("b", "a", r=1)], "ab", root="a"))
    assert longer.in_loop(0) and longer.in_loop(1) and longer.depth() == 1


def test_ratios_become_whole_octaves_counted_from_the_root():
    graph = parsed(document([edge("a", "b", scale=2.5), edge("b", "c", scale=2.5)]))
    assert [e.r for e in graph.edges] == [1, 2]  # 6.25 in all: 8 is nearer than 4
    assert graph.factors == pytest.approx((1.0, 2 / 2.5, 8 / 6.25))
    assert all(1 / math.sqrt(2) <= f <= math.sqrt(2) for f in graph.factors)


def test_more_is_resampled_where_it_is_asked_for():
    """scale says what the files are, r what they are to be."""
    within = parsed(document([edge("a", "b", scale=3, r=2)], "ab"))
    assert within.edges == (Edge(0, 1, 2),) and within.factors == pytest.approx((1.0, 4 / 3))
    far = parsed(document([edge("a", "b", scale=3, r=3), edge("b", "b", r=1)], "ab", resample=True))
    assert far.edges == (Edge(0, 1, 3), Edge(1, 1, 1)) and far.factors == pytest.approx((1.0, 8 / 3))


@pytest.mark.parametrize(
    "name, depth", [("map1800_bobruisk", 4), ("mars", 3), ("drone_caliterra", 2), ("sand_grain_ladder", 2)]
)
def test_the_test_graphs_are_imported(name, depth):
    graph = read_graph(data_folder() / "multiscale" / name / "graph.json")
    assert graph.root == 0 and graph.depth() == depth
    assert all(file.is_file() for file in graph.files)
    assert all(abs(f - 1) < 0.26 for f in graph.factors)


@pytest.fixture
def yaml(monkeypatch):
    """PyYAML, or what stands for it where it is not installed: JSON is YAML."""
    try:
        import yaml
    except ImportError:
        yaml = types.ModuleType("yaml")
        yaml.YAMLError = json.JSONDecodeError
        yaml.safe_load = json.loads
        monkeypatch.setitem(sys.modules, "yaml", yaml)
    return yaml


def test_yaml_says_the_same(tmp_path, yaml):
    path = tmp_path / "g.yaml"
    path.write_text('{"exemplars": [{"id": "a", "file": "a.png"}], "edges": [{"from": "a", "to": "a", "r": 1}]}')
    assert read_graph(path).edges == (Edge(0, 0, 1),)
    path.write_text('{"exemplars": [\n')
    with pytest.raises(ImageError, match=r"g\.yaml: not YAML: .*line 2") as caught:
        read_graph(path)
    assert "\n" not in str(caught.value)


def test_yaml_wants_a_package_that_may_not_be_there(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "yaml", None)
    (tmp_path / "g.yml").write_text("exemplars: [{id: a, file: a.png}]")
    with pytest.raises(ImageError, match=r"PyYAML .*pip install pyyaml"):
        read_graph(tmp_path / "g.yml")


WRONG = [
    ([], "expected an object of exemplars, nodes, root, edges, jitter, not a list"),
    ({}, "no exemplars: expected at least one"),
    ({"exemplars": {}}, "exemplars: expected a list, not an object"),
    (document(CHAIN, nodes=[]), "exemplars conflicts with nodes"),
    ({"exemplars": [], "nodes": [{"file": "a.exr"}]}, "exemplars conflicts with nodes"),
    (document(CHAIN, sede=1), "unknown key 'sede', did you mean 'seed'"),
    ({"exemplars": [{"id": "a"}]}, r"exemplars\[0\]: file is missing: expected a string"),
    ({"exemplars": [{"file": ""}]}, r"exemplars\[0\].file: expected a string of one character or more, not ''"),
    (document((), "aa"), "duplicate exemplar 'a'"),
    (document([edge("a", "x", r=1)]), "edge a -> x: unknown exemplar 'x': expected one of a, b, c"),
    (document([{"from": "a", "r": 1}]), r"edges\[0\]: to is missing: expected a string"),
    (document([edge("a", "b")]), "edge a -> b: expected r or scale, the ratio of their pixel sizes"),
    (
        document([edge("a", "b", r=3, scale=3), edge("b", "c", r=1)]),
        r"edge a -> b: r=3 would resample exemplar 'b' 2.667 times: expected at most sqrt\(2\); set .resample.: true",
    ),
    (document([*CHAIN, edge("b", "c", scale=2, r=2)]), "edge b -> c: r=2 conflicts with r=1 from the other edges"),
    (document(CHAIN, resample=1), "resample: expected true or false, not 1"),
    (document([edge("a", "b", r=1.5)]), r"edges\[0\].r: expected an integer >= 0, not 1.5"),
    (document([edge("a", "b", r=-1)]), r"edges\[0\].r: expected an integer >= 0, not -1"),
    (document([edge("a", "b", scale=0.5)]), r"edges\[0\].scale: expected a number from 1 to 1073741824, not 0.5"),
    (document([*CHAIN, edge("c", "a", r=1)]), "the root is ambiguous .every exemplar is the end of an edge.: set root"),
    (document([edge("a", "c", r=1)]), "the root is ambiguous .a or b.: set root"),
    (document(CHAIN, root="x"), "unknown root 'x': expected one of a, b, c"),
    (document([edge("a", "b", r=1)], root="a"), "no edges lead from root 'a' to exemplar 'c'"),
    (document([*CHAIN, edge("c", "c", scale=3)]), "edge c -> c: scale=3 closes a loop or a second path"),
    (document(CHAIN, jitter=[2]), r"jitter\[0\]: expected a number from 0 to 1, not 2"),
    (document(CHAIN, jitter=[]), "jitter is empty"),
    (document(CHAIN, seed=-1), "seed: expected an integer from 0 to 4294967295, not -1"),
]


@pytest.mark.parametrize("found, message", WRONG, ids=[message[:40] for _, message in WRONG])
def test_what_is_wrong_is_said(found, message):
    with pytest.raises(ImageError, match=message) as caught:
        parsed(found)
    assert str(caught.value).startswith("maps/g.json: ") and "\n" not in str(caught.value)


def test_what_cannot_be_read_is_said(tmp_path):
    with pytest.raises(ImageError, match="No such file"):
        read_graph(tmp_path / "none.json")
    (tmp_path / "bad.json").write_text("{")
    with pytest.raises(ImageError, match=r"not JSON: .* line 1"):
        read_graph(tmp_path / "bad.json")
    (tmp_path / "bytes.json").write_bytes(b"\xff\xfe")
    with pytest.raises(ImageError, match="not text"):
        read_graph(tmp_path / "bytes.json")


def test_edges_over_more_octaves_than_stacks_overlap_are_refused():
    graph = parsed(document(json.loads(json.dumps(CHAIN))))
    graph.require_levels(5, "g.json")
    with pytest.raises(ImageError, match=r"a -> b: r=2 .*16 px"):
        graph.require_levels(4, "g.json")


def test_one_exemplar_is_a_graph_without_edges():
    graph = Graph.single("photo.jpg")
    assert (graph.names, graph.edges, graph.depth(), graph.leads_on(0)) == (("photo.jpg",), (), 0, False)
