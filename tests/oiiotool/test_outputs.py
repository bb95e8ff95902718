# SPDX-License-Identifier: Apache-2.0
"""What an output's kind says, over every output of every filter; and the runner that makes parts, files and lines."""

from __future__ import annotations

import json
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import OpenImageIO as oiio
import pytest

from oiiotex import filters
from oiiotex.engine import errors
from oiiotex.engine.core.access import Pointwise
from oiiotex.engine.core.image import Image, from_buffer
from oiiotex.engine.core.op import Kind, Op, Output, Plan, Space
from oiiotex.engine.core.parameters import image, param
from oiiotex.engine.io.reading import read
from oiiotex.engine.run import run
from oiiotex.engine.session import Session
from oiiotex.engine.session.facts import Facts
from tests.any_filter import PHOTO, buffer, image_of, named, of, operands, settings, with_labels
from tests.conftest import oiiotex, save

READ = {"palette", "graph", "draw", "fromplan", "mesh", "motion", "lights"}  # name files that the op reads
TYPES = {
    Kind.IDS: "uint", Kind.MASK: "float", Kind.COORDINATES: "float", Kind.MEASURE: "float", Kind.CRYPTOMATTE: "float",
    Kind.PICTURE: "uint8", Kind.PIXELS: "half",
}  # fmt: skip
EXACT = (Kind.IDS, Kind.COORDINATES)  # another value would be another meaning
COLORS = (Kind.PIXELS, Kind.PICTURE)
UNFIT = {Kind.COORDINATES: "x.png", Kind.PICTURE: "x.exr"}  # formats that cannot hold them
SIDE_FILES = [
    pytest.param(op, o, id=f"{op.name}-{o.name}")
    for op in filters.FILTERS
    for o in op.outputs
    if Path in (next((p.kind for p in op.parameters() if p.attribute == o.asked_by), None) or ())
    and o.name[-2:] != ".N"
]


def used(op: type[Op], source: Image | None = None, **values: Any) -> Op:
    """One cheap use of the op, on a photo in halfs."""
    given = [image_of(b) for b in operands(op, buffer(PHOTO, oiio.HALF))]
    given[0] = with_labels(op, source) if source else given[0]
    return op(**{**named(op, given), **settings(op), **values})


@of(list(filters.FILTERS))
def test_parts_are_what_their_kinds_say(op):
    """All that can be asked for as a part: its type, its tag, and that nobody may convert what must stay as it is."""
    asked = [o for o in op.outputs if o.asked_by and o.kind.is_image and (o.kind is not Kind.PIXELS or o.of)]
    flags = {p.attribute for p in op.parameters() if bool in (p.kind or ())}
    (made, *_) = run(used(op, **{o.asked_by: True for o in asked if o.asked_by in flags}), Session())
    kept = sum(bool(o.of) for o in asked)
    names = (op.main().name, *(part.name for part in made.image.parts[kept + 1 :]))
    for name, part in zip(names, made.image.parts[kept:], strict=True):
        kind = op.output(name).kind
        if op.name != "graph" and not (op.space is Space.ANY and kind is Kind.PIXELS):
            assert str(part.spec.format) == TYPES[kind], name
        assert part.exact == (kind in EXACT)
        assert (
            part.read(part.window).dtype
            == {"uint": "u4", "float": "f4", "uint8": "u1", "half": "f2"}[str(part.spec.format)]
        )
        tag = "srgb_rec709_scene" if kind in COLORS else "data"
        assert part.spec.get_string_attribute("oiio:ColorSpace") == tag
        assert part.spec.get_string_attribute("oiiotex:filter") == op.name
    families = {op.output(name).name for name in names}
    never = {"transfer", "roughness"}  # of graphs; another image
    never |= {"label.N"} if op.main().name != "label.N" else set()  # of photos with labels
    assert families >= {o.name for o in asked if o.asked_by in flags and not o.of} - never


@of(list(filters.FILTERS))
def test_every_file_that_an_op_names_is_an_output_or_read(op):
    files = {p.attribute for p in op.parameters() if Path in (p.kind or ())}
    assert files <= {o.asked_by for o in op.outputs} | READ
    assert {o.asked_by for o in op.outputs} - {""} <= {p.attribute for p in op.parameters()}


@pytest.mark.parametrize(("op", "output"), SIDE_FILES)
def test_a_side_file_is_refused_before_the_work(op, output, tmp_path, monkeypatch):
    save(PHOTO, tmp_path / "photo.exr", "half", "srgb_rec709_scene")
    before = (tmp_path / "photo.exr").read_bytes()

    def never(self: Op, facts: Facts) -> None:
        pytest.fail("the op is planned")

    monkeypatch.setattr(op, "plan", never)

    def refused(kind: type[Exception], path: Path, said: str, written: set[str] | None = None, **more: Path) -> None:
        with pytest.raises(kind, match=said):
            run(used(op, read(tmp_path / "photo.exr"), **{output.asked_by: path}, **more), Session(), written)
        assert sorted(os.listdir(tmp_path)) == ["link.exr", "photo.exr"]

    (tmp_path / "link.exr").symlink_to("photo.exr")
    for name in ("photo.exr", "link.exr"):
        refused(
            errors.ParameterError, tmp_path / name, f"{output.asked_by}=.*{name} would overwrite {op.images()[0].name}"
        )
    new = tmp_path / "new.exr"
    refused(errors.ParameterError, new, "would overwrite a file written by an earlier op", {os.path.realpath(new)})
    refused(errors.ImageError, tmp_path / "nowhere" / "x.exr", "no such folder")
    others = {o.asked_by for _, o in (p.values for p in SIDE_FILES if p.values[0] is op)} - {output.asked_by}
    for other in others:
        refused(errors.ParameterError, new, "new.exr would overwrite", **{other: new})
    if output.kind in UNFIT:
        refused(errors.ImageError, tmp_path / UNFIT[output.kind], "cannot hold")
    assert (tmp_path / "photo.exr").read_bytes() == before


@dataclass(frozen=True, kw_only=True)
class Sample(Pointwise):
    """An output of every way to leave."""

    name: ClassVar[str] = "sample"
    space: ClassVar[Space] = Space.ANY
    carries: ClassVar[bool] = True
    outputs: ClassVar[tuple[Output, ...]] = (
        Output("before", Kind.PIXELS, "the image", asked_by="keep", of="source"),
        Output("image", Kind.PIXELS, "the image"),
        Output("st.N", Kind.COORDINATES, "several", asked_by="st"),
        Output(
            "facts", Kind.TABLE, "facts", asked_by="json", lines=lambda facts: (f"{k} is {v}" for k, v in facts.items())
        ),
        Output("arrays", Kind.ARRAYS, "arrays", asked_by="arrays"),
    )

    source: Image = image(help="the image")
    keep: bool = param(False, help="keep it")
    st: bool | Path = param(False, help="coordinates")
    json: Path | None = param(None, help="facts")
    arrays: Path | None = param(None, help="arrays")

    def make(self, plan: Plan, session: Session) -> dict[str, Any]:
        part = self.source.first
        more = {f"st.{n}": (lambda n=n: part.respecced(lambda spec: spec.attribute("n", n))) for n in (1, 2)}

        def facts() -> dict[str, int]:
            CALLED.append("facts")
            return {"x": 1, "y": 2}

        return {"image": part, **more, "facts": facts, "arrays": lambda: {"a": np.arange(3)}}


CALLED: list[str] = []


def source() -> Image:
    two = from_buffer(buffer(PHOTO[..., :2])).first, from_buffer(buffer(PHOTO[..., :1])).first
    return Image(tuple(two), "a")


def test_nothing_is_made_that_nobody_asked_for():
    CALLED.clear()
    ((made, names, _),) = run(Sample(source=source()), Session())
    assert (CALLED, names, len(made.parts)) == ([], ("image", "part0"), 2)  # what the source had beside it follows
    said: list[str] = []
    run(Sample(source=source()), Session(say=said.append))
    assert (CALLED, said) == (["facts"], ["x is 1", "y is 2"])


def test_what_is_kept_is_first_and_what_is_asked_for_follows():
    ((made, names, _),) = run(Sample(source=source(), keep=True, st=True), Session())
    assert names[2:4] == ("st.1", "st.2") and [p.exact for p in made.parts] == [False, False, True, True, False]
    assert made.parts[3].spec.get_int_attribute("n") == 2


def test_files_hold_all_that_one_modifier_asks_for_and_say_how_they_were_made(tmp_path):
    written: set[str] = set()
    asked = {"st": tmp_path / "st.exr", "json": tmp_path / "f.json", "arrays": tmp_path / "p.npz"}
    ((made, _, _),) = run(Sample(source=source(), **asked), Session(), written)
    assert len(made.parts) == 2 and written == {os.path.realpath(path) for path in asked.values()}
    maps = read(asked["st"])
    assert [p.name for p in maps.parts] == ["st.1", "st.2"]
    assert maps.first.spec.get_string_attribute("oiiotex:filter") == "sample"
    assert json.loads(asked["json"].read_text()) == {"x": 1, "y": 2}
    with np.load(asked["arrays"]) as held:
        np.testing.assert_array_equal(held["a"], np.arange(3))
    run(Sample(source=source(), **asked), Session(), provenance=False)
    assert read(asked["st"]).first.spec.get_string_attribute("oiiotex:filter") == ""


def test_an_undeclared_output_is_a_mistake(monkeypatch):
    monkeypatch.setattr(Sample, "make", lambda self, plan, session: {"image": self.source.first, "other": None})
    with pytest.raises(KeyError, match=r"other"):
        run(Sample(source=source()), Session())


def test_a_plan_that_is_read_is_not_overwritten(tmp_path):
    filters.quilt(buffer(PHOTO), size=(40, 40), planfile=tmp_path / "p.npz")
    held = (tmp_path / "p.npz").read_bytes()
    with pytest.raises(errors.ParameterError, match="would overwrite fromplan, an input file"):
        filters.quilt(buffer(PHOTO), fromplan=tmp_path / "p.npz", st=tmp_path / "p.npz")
    assert (tmp_path / "p.npz").read_bytes() == held


def test_a_line_does_not_write_one_file_twice(tmp_path, photo):
    words = [photo, "--texcut:st=st.exr:size=16x16"] * 2
    done = oiiotex(*words, cwd=tmp_path)
    assert done.returncode == 1 and "st=st.exr would overwrite a file written by an earlier op" in done.stderr
    done = oiiotex(photo, "--nosoftwareattrib", "--texcut:st=st.exr:size=16x16", "-o", "a.exr", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert read(tmp_path / "st.exr").first.spec.get_string_attribute("oiiotex:filter") == ""
    done = oiiotex(photo, "--texcut:st=st.exr:size=16x16", "-otex", "st.exr", cwd=tmp_path)
    assert done.returncode == 1 and "would overwrite a file written by an earlier op" in done.stderr


@pytest.mark.parametrize("line", ["--texlab --flip", "--texstationarity --crop 32x20+2+2", "--texlab --resize 20x20"])
def test_values_beyond_a_photos_type_survive_ops_of_the_host(line, photo, tmp_path):
    """An 8-bit photo's Lab and measures are floats; written as the first file was they would be cut."""
    assert oiiotex(photo, *line.split(), "-o", "out.tif", cwd=tmp_path).returncode == 0
    made = oiio.ImageBuf(str(tmp_path / "out.tif"))
    assert made.spec().format == oiio.FLOAT and made.get_pixels().max() > 1.5
    assert oiiotex(photo, *line.split(), "-d", "uint8", "-o", "small.tif", cwd=tmp_path).returncode == 0
    assert oiio.ImageBuf(str(tmp_path / "small.tif")).spec().format == oiio.UINT8
