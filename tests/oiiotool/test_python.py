# SPDX-License-Identifier: Apache-2.0
"""The functions as Python has them: types, what they take, what they say; the guide's examples are run."""

from __future__ import annotations

import ast
import inspect
import os
import re
import shutil
import subprocess
import sys
import typing
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest

import oiiotex
from oiiotex import filters
from oiiotex.engine import errors
from oiiotex.engine.session import Session
from oiiotex.python import python_types
from oiiotex.python.signatures import forms, signature
from tests import pictures
from tests.any_filter import buffer, pixels
from tests.conftest import load, save
from tests.refusals import refused
from tools.docs.stubs import stub_text

pytestmark = pytest.mark.usefixtures("few_places")
ROOT = Path(__file__).parents[2]
SRGB = "srgb_rec709_scene"
PHOTO = np.rint(255 * pictures.stained(pictures.bricks(48, 56, seed=1))).astype(np.uint8)
QUICK = {"iterations": 2, "seed": 3}
every_filter = pytest.mark.parametrize("op", filters.OURS, ids=lambda op: op.name)


def as_buffer(array: np.ndarray, space: str = SRGB) -> oiio.ImageBuf:
    made = oiio.ImageBuf(oiio.ImageSpec(array.shape[1], array.shape[0], array.shape[2], oiio.UINT8))
    made.specmod().attribute("oiio:ColorSpace", space)
    made.set_pixels(made.roi, array)
    return made


def test_results_are_arrays_for_others_and_pil_images_are_taken():
    from PIL import Image

    flat = filters.flatten(PHOTO, colorspace=SRGB)
    shown = np.asarray(flat)
    assert shown.dtype == np.uint8 and np.asarray(flat, np.float32).dtype == np.float32
    np.testing.assert_array_equal(shown, flat.get_pixels(oiio.UINT8))
    array = filters.flatten(Image.fromarray(PHOTO), colorspace=SRGB, as_array=True)
    assert type(array) is np.ndarray and array.dtype == shown.dtype
    np.testing.assert_array_equal(array, shown)
    parts = filters.superpixel(PHOTO, colorspace=SRGB, photo=True, as_array=True)
    assert {name: type(part) for name, part in parts.items()} == {"part0": np.ndarray, "superpixels": np.ndarray}
    assert parts["superpixels"].shape == PHOTO.shape[:2] and parts["superpixels"].dtype.kind == "u"
    assert np.asarray(filters.dominant(PHOTO, colorspace=SRGB)).shape == PHOTO.shape[:2]
    clear = Image.fromarray(np.dstack([PHOTO, np.full(PHOTO.shape[:2], 128, np.uint8)]))
    premultiplied = np.asarray(filters.warp(clear, np.zeros((4, 4, 2), np.float32)))
    assert (premultiplied[..., :3] <= 128).all() and (premultiplied[..., 3] == 128).all()
    with pytest.raises(TypeError, match=r"mode CMYK.*convert"):
        filters.flatten(Image.fromarray(PHOTO).convert("CMYK"))


class Lazy:
    """An array of another library, such as xarray's."""

    def __dask_graph__(self):
        return None

    def __array__(self, dtype=None, copy=None):
        return PHOTO


@pytest.mark.parametrize(
    ("array", "says"),
    [
        (np.moveaxis(np.zeros((8, 80, 3)), 2, 0), r"shape \(3, 8, 80\) .*; call numpy.moveaxis\(array, 0, -1\)"),
        (np.zeros((8, 8, 3), int), "type int64: expected uint8, uint16 or floats; 64-bit integers are label ids"),
        (np.zeros((0, 8, 3)), "expected at least one pixel"),
        (np.ma.masked_array(np.zeros((8, 8, 3)), True), "MaskedArray of .*; give its data, and mask=~array.mask"),
        (Lazy(), "not Lazy; call numpy.asarray on it"),
        ([[1, 2], [3, 4]], "not list; call numpy.asarray on it"),
    ],
)
def test_arrays_that_are_no_photos_are_refused_with_a_hint(array, says):
    with pytest.raises(errors.Error, match=says):
        filters.flatten(array, colorspace="srgb_rec709_scene")


def test_dask_arrays_are_refused_with_a_hint():
    array = pytest.importorskip("dask.array").from_array(PHOTO)
    with pytest.raises(TypeError, match=r"dask Array.*compute\(\)"):
        filters.flatten(array)


# --- the guide ---


def test_the_examples_of_the_guide_run(tmp_path, monkeypatch, capsys):
    save(pictures.stained(pictures.bricks(80, 96, seed=1)), tmp_path / "photo.png")
    monkeypatch.chdir(tmp_path)
    blocks = re.findall(r"```python\n(.*?)```", (ROOT / "docs" / "reference" / "python.md").read_text(), re.DOTALL)
    names: dict[str, object] = {}
    for block in blocks:
        exec(compile(block, "docs/reference/python.md", "exec"), names)
    assert names["pixels"].shape == (96, 96, 3) and names["pixels"].dtype == np.uint8
    assert list(names["parts"]) == ["part0", "superpixels"]
    assert {p.name for p in tmp_path.iterdir()} >= {"flat.exr", "st.exr", "tile.0.png", "tile.1.png"}
    for made, seed in zip(names["tiles"], range(2), strict=True):
        np.testing.assert_array_equal(pixels(made), load(tmp_path / f"tile.{seed}.png"))
    said = capsys.readouterr().out.splitlines()
    assert said[0].startswith("canceled after (")
    assert [line.split()[0] for line in said[1:]] == ["ParameterTypeError", "ParameterError", "ParameterTypeError"]


# --- what is taken ---


def test_an_array_a_file_and_a_buffer_give_the_same_pixels(tmp_path):
    save(PHOTO / 255, tmp_path / "photo.png")
    expected = pixels(filters.flatten(as_buffer(PHOTO)))
    for given in (PHOTO, PHOTO[::-1][::-1], str(tmp_path / "photo.png"), tmp_path / "photo.png", {"a": PHOTO}):
        made = filters.flatten(given, colorspace=SRGB)
        np.testing.assert_array_equal(pixels(made), expected)
        assert made.spec().get_string_attribute("oiio:ColorSpace") == SRGB


@pytest.mark.parametrize(
    ("array", "names", "kind"),
    [
        (np.zeros((4, 5), np.uint16), ("Y",), "uint16"),
        (np.zeros((4, 5, 3), ">f4"), ("R", "G", "B"), "float"),
        (np.zeros((4, 5, 4), np.float16), ("R", "G", "B", "A"), "half"),
        (np.zeros((4, 5, 1), bool), ("Y",), "float"),
        (np.full((4, 5), (1 << 32) - 1, np.int64), ("Y",), "uint"),
    ],
)
def test_arrays_are_images(array, names, kind):
    from oiiotex.engine.core.image import from_array

    part = from_array(array).first
    assert (part.spec.channelnames, str(part.spec.format)) == (names, kind)
    assert part.spec.alpha_channel == (3 if "A" in names else -1)
    np.testing.assert_array_equal(part.pixels(), array.reshape(part.pixels().shape))


@pytest.mark.parametrize(
    "array", [np.full((4, 4), -1), np.full((4, 4), 1 << 32), np.zeros((2, 2, 2, 2)), np.zeros((2, 2), "U1")]
)
def test_other_arrays_are_refused(array):
    with pytest.raises(errors.ImageError, match="array"):
        filters.warp(array, array)


def test_colorspace_stands_before_the_tag_and_must_be_known():
    photo = as_buffer(PHOTO, "lin_rec709_scene")
    a = filters.flatten(photo, colorspace=SRGB)
    np.testing.assert_array_equal(pixels(a), pixels(filters.flatten(as_buffer(PHOTO))))
    assert photo.spec().get_string_attribute("oiio:ColorSpace") == "lin_rec709_scene"  # the caller's own
    with pytest.raises(errors.ColorError, match="sRGBB"):
        filters.warp(PHOTO, np.zeros((4, 4, 2), np.float32), colorspace="sRGBB")


def test_masks_are_arrays_files_or_names_of_parts(tmp_path):
    mask = np.zeros(PHOTO.shape[:2], bool)
    mask[:, 20:] = True
    save(mask[..., None], tmp_path / "mask.png")
    parts = {"photo": PHOTO, "mask": mask}
    made = [
        pixels(filters.stationarize(given, mask=one, colorspace=SRGB, **QUICK))
        for given, one in (
            (PHOTO, mask),
            (PHOTO, tmp_path / "mask.png"),
            (PHOTO, f"{tmp_path}/mask.png"),
            (parts, "mask"),
        )
    ]
    for other in made[1:]:
        np.testing.assert_array_equal(made[0], other)
    with refused(
        errors.ParameterError, parameter="mask", value="no", expected="a part of the image (part0) or an existing file"
    ):
        filters.stationarize(PHOTO, mask="no", colorspace=SRGB)


def test_an_optional_exemplar_may_be_none(tmp_path):
    with pytest.raises(TypeError, match=r"^synth: .*1 image.* 0$"):
        filters.synth(None)
    with pytest.raises(TypeError, match=r"^zoom: .*1 image.* 2$"):
        filters.zoom(PHOTO, PHOTO)


# --- what is said ---


def test_a_wrong_type_is_a_type_error():
    for wrong, said in (
        ({"sigma": "20"}, "stationarize: sigma='20': expected a number from 0.5 to 1000000 px, not str"),
        ({"sgima": 20}, "stationarize: unknown parameter 'sgima', did you mean 'sigma'?"),
        ({"kinds": "color"}, "stationarize: kinds='color': expected a sequence of strings, not str"),
        ({"colorspace": 5}, "stationarize: colorspace=5: expected the name of a color space, not int"),
        ({"session": 5}, "stationarize: session=5: expected a Session, not int"),
        ({"nthreads": "2"}, "stationarize: nthreads='2': expected a number of threads, not str"),
        ({"roi": (0, 9)}, "stationarize: roi=(0, 9): expected an OpenImageIO.ROI, not tuple"),
        ({"as_array": "no"}, "stationarize: as_array='no': expected True or False, not str"),
    ):
        with pytest.raises(TypeError) as caught:
            filters.stationarize(PHOTO, **({"colorspace": SRGB} | wrong))
        assert str(caught.value) == said and isinstance(caught.value, oiiotex.Error)


def test_errors_speak_python(tmp_path):
    broken = np.where(np.arange(3) == 1, np.nan, PHOTO / np.float32(255)).astype(np.float32)
    for call, said in (
        (lambda: filters.stationarize(PHOTO), "array has no color space tag ('oiio:ColorSpace'); add colorspace=NAME"),
        (lambda: filters.stationarize(PHOTO), "or colorspace='data' for maps other than color"),
        (
            lambda: filters.stationarize(broken, colorspace=SRGB),
            "repair them with OpenImageIO.ImageBufAlgo.fixNonFinite",
        ),
        (lambda: filters.quilt(PHOTO, colorspace=SRGB, label=1), "create them with filters.label(photo=True)"),
        (
            lambda: filters.stationarize(PHOTO, colorspace=SRGB, session=Session(budget=1 << 10)),
            "the session's budget",
        ),
        (lambda: filters.lab(PHOTO, colorspace="data"), "add colorspace=NAME if it is color"),
    ):
        with pytest.raises(errors.Error) as caught:
            call()
        assert said in str(caught.value) and "--" not in str(caught.value)


@every_filter
def test_docstrings_show_types_of_python(op):
    text = getattr(filters, op.name).__doc__
    for name, p in signature(op).parameters.items():
        star = "*" if p.kind is p.VAR_POSITIONAL else ""
        assert f"\n{star}{name} : {p.annotation}" in text
    said = text.partition("\nReturns\n")[0]
    assert "--tex" not in text and "WIDTHxHEIGHT" not in text and "0 or 1" not in said and "=1)" not in said


# --- types ---


def test_dir_shows_functions_alone():
    assert dir(filters) == sorted(op.name for op in filters.FILTERS)
    assert all(inspect.isfunction(getattr(filters, name)) for name in dir(filters))


def test_the_stub_has_every_filter():
    names = {node.name for node in ast.parse(stub_text()).body if isinstance(node, ast.FunctionDef)}
    assert names == {op.name for op in filters.OURS} | {"further", "op_named"}


@every_filter
def test_every_keyword_is_annotated(op):
    function = getattr(filters, op.name)
    for p in function.__signature__.parameters.values():
        assert p.annotation is not p.empty
        assert eval(p.annotation, vars(python_types)) is not None
    returns = eval(function.__signature__.return_annotation, vars(python_types))
    assert typing.get_args(returns) or returns is oiio.ImageBuf


def kinds_of(result: object) -> str:
    if isinstance(result, list):
        return f"list[{kinds_of(result[0])}]"
    if isinstance(result, dict):
        return "dict[str, ImageBuf]"
    return "ImageBuf" if isinstance(result, oiio.ImageBuf) else type(result).__name__


def test_results_are_as_the_stub_says():
    """Of what the forms tell apart, once with and once without."""
    photo, labeled = (
        buffer(PHOTO / 255),
        {"photo": buffer(PHOTO / 255), "label.1": np.indices((48, 56)).sum(0) // 60 + 1},
    )
    calls = {
        "stationarize": (photo, {**QUICK}),
        "cut": (photo, {}),
        "superpixel": (photo, {}),
        "lab": (photo, {}),
        "composite": (labeled, {"labellevel": 1, "size": (64, 64)}),
        "dominant": (photo, {"patch": 5} if "patch" in inspect.signature(filters.dominant).parameters else {}),
    }
    for op in filters.OURS:
        if op.name not in calls:
            continue
        given, values = calls[op.name]
        for form in forms(op):
            asked = dict.fromkeys(form.required, True)
            result = kinds_of(getattr(filters, op.name)(given, **values, **asked))
            assert result in form.returns.split(" | "), (op.name, form)
    several = kinds_of(filters.stationarize(photo, maps=[PHOTO[..., :1]], **QUICK))
    assert several == "list[ImageBuf]"


PROGRAM = """
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
from numpy.typing import NDArray
from typing import assert_type

from oiiotex import Error, filters
from oiiotex.engine.errors import Interrupted
from oiiotex.engine.session import Session


def work(photo: NDArray[np.uint8]) -> oiio.ImageBuf:
    session = Session(threads=1, progress=lambda done, total: done < 9)
    assert_type(filters.stationarize(photo, sigma=32, size=(64, 64), tiles="x", session=session), oiio.ImageBuf)
    assert_type(filters.stationarize("photo.png", st=True), dict[str, oiio.ImageBuf])
    assert_type(filters.stationarize(Path("photo.png"), st=Path("st.exr")), oiio.ImageBuf)
    parts = filters.superpixel(photo, photo=True, colorspace="srgb_rec709_scene")
    assert_type(parts, dict[str, oiio.ImageBuf])
    assert_type(filters.labelview(parts), oiio.ImageBuf)
    assert_type(filters.lab(photo, inverse=True), oiio.ImageBuf)
    assert_type(filters.flatten(photo), oiio.ImageBuf)
    width: int = filters.stationarize(photo, as_array=True).shape[1]
    print(width)
    assert_type(filters.graph(photo, photo, graphfile="g.json"), oiio.ImageBuf)
    tiles = filters.stationarize(photo, maps=[photo], kinds=["color", "normal"], mapweights=(1, 0.5))
    if isinstance(tiles, list):
        print(len(tiles))
    try:
        return filters.synth(photo, window="9x9+0+0")
    except (Error, Interrupted):
        raise SystemExit from None
"""
MISTAKES = (
    'filters.stationarize("p.png", sigma="20")',
    'filters.stationarize("p.png", sgima=20)',
    'filters.stationarize("p.png", tiles="z")',
    'filters.stationarize("p.png", size=64)',
    "filters.stationarize()",
    "filters.stationarize(3)",
    'filters.stationarise("p.png")',
    'filters.warp("p.png")',
)


def mypy(*words: object, folder: Path) -> list[str]:
    """The errors that mypy --strict finds."""
    pytest.importorskip("mypy", reason="LEFT OUT: there is no mypy: pip install oiiotex[test]")
    command = [
        sys.executable,
        "-m",
        "mypy",
        "--strict",
        "--follow-imports=silent",
        f"--cache-dir={Path(sys.prefix, 'mypy')}",  # of what others declare: minutes on slow machines
        *map(str, words),
    ]
    done = subprocess.run(
        command, capture_output=True, text=True, cwd=folder, env={**os.environ, "MYPYPATH": str(folder)}
    )
    assert done.returncode in (0, 1), done.stderr
    return [line for line in done.stdout.splitlines() if ": error: " in line]


def test_a_users_program_is_clean_and_its_mistakes_are_seen(tmp_path):
    program = tmp_path / "program.py"
    lines = PROGRAM.strip().splitlines()
    program.write_text("\n".join([*lines, "", *MISTAKES]))
    shutil.copytree(ROOT / "oiiotex", tmp_path / "oiiotex", ignore=shutil.ignore_patterns("__pycache__"))
    (tmp_path / "oiiotex" / "filters" / "__init__.pyi").write_text(stub_text())
    seen = {int(re.search(r":(\d+):", line)[1]) for line in mypy(program, folder=tmp_path)}
    assert seen == {len(lines) + 2 + n for n in range(len(MISTAKES))}


def test_the_wheel_says_that_it_is_typed():
    import tomllib

    data = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]["package-data"]
    assert data["oiiotex"] == ["py.typed"]
    assert (ROOT / "oiiotex" / "py.typed").exists()
