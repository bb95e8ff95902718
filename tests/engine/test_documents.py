# SPDX-License-Identifier: Apache-2.0
"""What users hand over beside images is not trusted: fifos, bombs, odd numbers and texts, graphs without end."""

from __future__ import annotations

import os
import stat
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, Literal, TypedDict

import numpy as np
import pytest

from oiiotex.engine.color.config import ColorConfig
from oiiotex.engine.errors import ImageError
from oiiotex.engine.io.atomic import temporary_beside
from oiiotex.engine.io.documents import read_arrays, read_document
from oiiotex.engine.io.schema import Allowed, Fraction, read_as
from oiiotex.synthesis.multiscale.graph import Edge, Graph, read_graph
from oiiotex.synthesis.quilting.guide_map import read_table
from oiiotex.synthesis.quilting.quilt_plan import Grid, QuiltPlan
from tests.conftest import oiiotex

NODE = '{"exemplars": [{"id": "a", "file": "a.png"}], '


@pytest.mark.parametrize(
    "text, said",
    [
        (NODE + '"seed": 1e999}', "beyond 2^53"),
        (NODE + '"seed": NaN}', "beyond 2^53"),
        (NODE + f'"seed": {10**400}}}', "beyond 2^53"),
        (NODE + f'"seed": {"9" * 5000}}}', "not JSON"),
        (NODE + '"title": "\\ud800"}', "unpaired surrogate"),
        ("[" * 100_000, "too deep"),
        (b"\xff\xfe", "not text in UTF-8"),
        ("[1]" + " " * (17 << 20), "file too large: expected at most 16 MB"),
    ],
)
def test_a_document_is_refused_in_one_line(tmp_path, text, said):
    path = tmp_path / "g.json"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(ImageError) as caught:
        read_graph(path)
    assert said in str(caught.value) and str(path) in str(caught.value) and "\n" not in str(caught.value)


@dataclass(frozen=True, kw_only=True)
class Leaf:
    end: str = field(metadata={"key": "from"})
    r: Annotated[int, Allowed(0, 9)] | None = None
    mode: Literal["x", "y"] = "x"


class Whole(TypedDict):
    leaves: tuple[Leaf, ...]
    share: Fraction | tuple[Fraction, ...]
    names: Mapping[str, bool]


WHOLE = {"leaves": [{"from": "a", "r": 3}, {"from": "b"}], "share": 1, "names": {"on": True}}


@pytest.mark.parametrize(
    "changes, said",
    [
        ({"leaves": {}}, "leaves: expected a list, not an object"),
        ({"leaves": [{"from": "a"}, 7]}, "leaves[1]: expected an object of from, r, mode, not 7"),
        ({"leaves": [{}]}, "leaves[0]: from is missing: expected a string"),
        (
            {"leaves": [{"from": "a", "mod": "x"}]},
            "leaves[0]: unknown key 'mod', did you mean 'mode'?; expected from",
        ),
        ({"leaves": [{"from": 1}]}, "leaves[0].from: expected a string, not 1"),
        ({"leaves": [{"from": "a", "r": True}]}, "leaves[0].r: expected an integer from 0 to 9, not True"),
        ({"leaves": [{"from": "a", "r": 3.0}]}, "leaves[0].r: expected an integer from 0 to 9, not 3.0"),
        ({"leaves": [{"from": "a", "r": 10**400}]}, "leaves[0].r: expected an integer from 0 to 9, not 1000"),
        ({"leaves": [{"from": "a", "mode": "z"}]}, "leaves[0].mode: expected 'x' or 'y', not 'z'"),
        ({"share": [0.5, float("nan")]}, "share[1]: expected a number from 0 to 1, not nan"),
        ({"share": 10**400}, "share: expected a number from 0 to 1 or a list, not 1000"),
        ({"names": {"on": 1}}, "names.on: expected true or false, not 1"),
        ({"names": None}, "names: expected an object, not None"),
    ],
)
def test_what_a_document_may_not_hold_is_said_with_its_place(changes, said):
    read = read_as(Whole, WHOLE, "d.json")
    assert read == {"leaves": (Leaf(end="a", r=3), Leaf(end="b")), "share": 1.0, "names": {"on": True}}
    with pytest.raises(ImageError) as caught:
        read_as(Whole, WHOLE | changes, "d.json")
    assert str(caught.value).startswith(f"d.json: {said}")


def test_yaml_that_stands_for_gigabytes_is_refused(tmp_path):
    pytest.importorskip("yaml")
    path = tmp_path / "g.yaml"
    path.write_text("a: &a [x, x]\nb: &b [*a, *a]\nc: &c [*b, *b]\n")
    with pytest.raises(ImageError, match="aliases"):
        read_document(path)
    path.write_text("title: 'R & D'\n")
    assert read_document(path) == {"title": "R & D"}


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no fifos here")
def test_a_fifo_is_refused_and_not_waited_for(tmp_path, photo):
    fifo = tmp_path / "fifo.json"
    os.mkfifo(fifo)
    for read in (read_graph, read_document, lambda p: read_arrays(p, 1 << 30), lambda p: ColorConfig(str(p))):
        with pytest.raises(ImageError.__mro__[1], match=r"fifo\.json: not a regular file"):
            read(fifo)
    with pytest.raises(ImageError, match="not a regular file"):
        read_table(fifo)
    for words in (("-o", "x.png"), ("--texlab", "-o", "x.exr")):
        done = oiiotex(photo, *words, cwd=tmp_path, env={**os.environ, "OCIO": str(fifo)})
        assert (done.returncode, done.stderr) == (1, f"oiiotex ERROR: {fifo}: not a regular file\n")


def test_arrays_are_refused_by_what_they_say_before_they_are_unpacked(tmp_path):
    path = tmp_path / "plan.npz"
    np.savez_compressed(path, facts=np.zeros(1 << 23, np.uint8))
    with pytest.raises(ImageError, match=r"9 MB.* 1 MB"):
        read_arrays(path, 1 << 20)
    lying = path.read_bytes()
    directory = lying.index(b"PK\1\2")
    path.write_bytes(lying[: directory + 24] + (100).to_bytes(4, "little") + lying[directory + 28 :])
    with pytest.raises(ImageError, match="cannot read arrays"):
        read_arrays(path, 1 << 20)
    with zipfile.ZipFile(path, "w") as packed:
        packed.writestr("facts.npy", b"\x93NUMPY\x01\x00v\x00{'descr': '|O', 'fortran_order': False, 'shape': (1,)}\n")
    with pytest.raises(ImageError, match="cannot read arrays"):
        read_arrays(path, 1 << 20)


@pytest.mark.parametrize(
    "changed",
    [
        {"facts": {1: 2**62}}, {"facts": {3: 0}}, {"facts": {4: 12}}, {"facts": {4: -3}}, {"facts": {5: 7}},
        {"facts": {7: 2**40}}, {"facts": np.float64}, {"offsets": np.float32}, {"offsets": np.int64},
        {"vertical": np.int8}, {"offsets": None},
    ],
)  # fmt: skip
def test_a_plan_of_odd_facts_is_refused(tmp_path, changed):
    plan = QuiltPlan.empty(Grid(61, 47, patch=12, overlap=4))
    plan.offsets[:] = 0
    arrays = plan.arrays((53, 45))
    path = tmp_path / "plan.npz"
    QuiltPlan.of(arrays, path)  # it is one
    for name, change in changed.items():
        if change is None:
            del arrays[name]
        elif isinstance(change, dict):
            for n, value in change.items():
                arrays[name][n] = value
        else:
            arrays[name] = arrays[name].astype(change)
    np.savez(path, **arrays)
    with pytest.raises(ImageError, match=r"not a complete plan|another version|has no"):
        QuiltPlan.load(path, 1 << 30)


def test_the_depth_of_a_graph_is_found_in_no_time():
    count = 60  # every exemplar leads to every other: there are 10^80 ways
    names = tuple(map(str, range(count)))
    edges = tuple(Edge(a, b, 1) for a in range(count) for b in range(count))
    assert Graph(names, (), 0, edges, (), ()).depth() == 1
    onward = tuple(Edge(a, b, 1) for a in range(count) for b in range(a + 1, count))
    assert Graph(names, (), 0, onward, (), ()).depth() == count - 1


# --- files that are written ---


def test_what_is_written_keeps_mode_and_link(tmp_path):
    target, link = tmp_path / "elsewhere" / "a.txt", tmp_path / "a.txt"
    target.parent.mkdir()
    target.write_text("old")
    target.chmod(0o640)
    link.symlink_to(target)
    with temporary_beside(link) as temporary:
        assert temporary.parent == target.parent and stat.S_IMODE(temporary.stat().st_mode) & 0o7 == 0
        temporary.write_text("new")
    assert link.is_symlink() and target.read_text() == "new" and stat.S_IMODE(target.stat().st_mode) == 0o640
    link.unlink()
    link.symlink_to("a.txt")
    with pytest.raises(ImageError, match="a broken link"), temporary_beside(link):
        pass


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() != 0, reason="only root lays links as somebody else")
def test_a_strangers_link_in_a_folder_for_all_is_refused(tmp_path):
    tmp_path.chmod(0o1777)
    (tmp_path / "mine").write_text("mine")
    link = tmp_path / "out.exr"
    link.symlink_to("mine")
    os.lchown(link, 12345, 12345)
    with pytest.raises(ImageError, match="a link of another user in a shared folder"), temporary_beside(link):
        pass


def test_temporary_names_cannot_be_foreseen_and_lead_through_no_link(tmp_path, monkeypatch):
    names = set()
    for _ in range(3):
        with temporary_beside(tmp_path / "a.txt") as temporary:
            names.add(temporary.name)
    assert len({name.rsplit("-", 1)[1] for name in names}) == 3
    monkeypatch.setattr("os.urandom", lambda count: bytes(count))
    with temporary_beside(tmp_path / "a.txt") as temporary:
        planted = temporary
    (tmp_path / "victim").write_text("mine")
    planted.symlink_to(tmp_path / "victim")
    with pytest.raises(ImageError, match="File exists"), temporary_beside(tmp_path / "a.txt"):
        pass
    assert (tmp_path / "victim").read_text() == "mine"
