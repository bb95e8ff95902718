# SPDX-License-Identifier: Apache-2.0
"""A recipe's line writes into its product's folder alone, whatever its words lead to."""

from __future__ import annotations

import contextlib
import os
import random
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import oiiotex_studio
import OpenImageIO as oiio
import pytest
from oiiotex_studio.library.steps import run_line
from oiiotex_studio.recipes.lines import ProductStep, require_confined, require_lines

import oiiotex
from oiiotex.engine.core.op import Op
from oiiotex.engine.errors import Error, ParameterError
from oiiotex.engine.io.atomic import make_folders, writing_only_below
from oiiotex.engine.io.checkpoint import Checkpoint
from oiiotex.engine.run import run
from oiiotex.engine.session import Session
from oiiotex.oiiotool.cli.language.parse import Option
from oiiotex.oiiotool.cli.vocabulary import LANGUAGE
from tests import sources
from tests.conftest import save
from tests.library_makings import recipe
from tests.oiiotool.test_outputs import SIDE_FILES, used

OUTSIDE = "is not in the product's folder"
SUFFIXES = ("exr", "tif", "json", "png")
# Not of a recipe: `require_lines` refuses them. Or they end the process, or ask for a machine.
NOT_HERE = {
    "--farm", "--share", "--join", "--openjd", "--texlive", "--tev", "--oiioattrib", "--frames", "--each", "--views",
    "--parallel-frames",
}  # fmt: skip


@pytest.fixture
def asset(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of an asset that is made, with a product and maps, in a tree where nothing else may change."""
    folder = tmp_path / "library" / "asset"
    for name in ("t", "other", "source"):
        (folder / name).mkdir(parents=True)
    for name in ("home", "elsewhere"):
        (tmp_path / name).mkdir()
        for suffix in SUFFIXES:
            (tmp_path / name / f"old.{suffix}").write_bytes(b"the user's own")
    (folder / "t" / "link").symlink_to(tmp_path / "elsewhere")
    for suffix in SUFFIXES:
        (folder / "t" / f"link.{suffix}").symlink_to(tmp_path / "elsewhere" / f"old.{suffix}")
    save(np.zeros((8, 8, 3)), folder / "source" / "color.png")
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    return folder


def leading_out(asset: Path) -> tuple[str, ...]:
    """Names, less a suffix, that lie outside of the product's folder."""
    elsewhere = asset.parent.parent / "elsewhere"
    return (
        f"{elsewhere}/old", f"{elsewhere}/new", "../asset/other/new", "t/../new", "new", "other/new", "./source/color",
        "~/old", "~root/new", "t/link/old", "t/link/new", "t/link", f"t/../../../elsewhere/{'x' * 20}",
        "../../elsewhere/old", f"{asset}/t/../other/new", "//tmp/../" + str(elsewhere).lstrip("/") + "/old",
        f"{elsewhere}/folders/that/are/new", "t/./link/../../new", "t.new",
    )  # fmt: skip


def tree(asset: Path) -> dict[str, bytes]:
    """All files below the asset's tree, those of its product left out, and folders."""
    top, out = asset.parent.parent, {}
    for folder, folders, names in os.walk(top):
        if Path(folder) == asset / "t":
            folders.clear()
            continue
        out |= {os.path.join(folder, name): Path(folder, name).read_bytes() for name in names}
        out |= {os.path.join(folder, name): b"" for name in folders}
    return out


def outcome(asset: Path, *words: str) -> str:
    """What a line says; nothing outside of the product's folder has changed."""
    before = tree(asset)
    try:
        run_line(ProductStep("t", words), asset)
        said = ""
    except Error as error:
        said = str(error)
    assert tree(asset) == before, words
    return said


# --- all that writes ---


def every_name(asset: Path, suffix: str, count: int, seed: int) -> list[str]:
    names = [f"{name}.{suffix}" for name in leading_out(asset)]
    return random.Random(seed).sample(names, count)


@pytest.mark.parametrize(("op", "output"), SIDE_FILES)
def test_no_modifier_of_a_filter_leads_out(asset, op, output, monkeypatch):
    monkeypatch.chdir(asset)

    def never(self: Op, session: Session) -> None:
        pytest.fail("the work has begun")

    monkeypatch.setattr(op, "make", never)
    before = tree(asset)
    for name in every_name(asset, "exr", 6, seed=len(output.name)):
        with writing_only_below(Path("t")), pytest.raises(Error, match=OUTSIDE):
            run(used(op, **{output.asked_by: Path(name)}), Session())
    assert tree(asset) == before


WRITERS = [option for option in LANGUAGE.options if option.writes]
OTHERS = [option for option in LANGUAGE.options if option.arguments and option not in WRITERS]


def test_what_writes_is_declared_so():
    assert {option.name for option in WRITERS} == {"-o", "-otex", "-oenv", "-obump", "--iccwrite"}


@pytest.mark.parametrize("option", WRITERS, ids=lambda option: option.name)
def test_no_option_that_writes_leads_out(asset, option):
    spec = oiio.ImageSpec(8, 8, 3, oiio.UINT8)
    spec.attribute("ICCProfile", oiio.TypeDesc("uint8[200]"), np.arange(200, dtype=np.uint8))
    assert oiio.ImageBuf(spec).write(str(asset / "source" / "color.tif"))
    for name in every_name(asset, "tif", 6, seed=len(option.name)):
        for words in ((option.name, name), (f"{option.name}:fileformatname=tiff", name.removesuffix(".tif"))):
            if option.modifiers or ":" not in words[0]:
                assert OUTSIDE in outcome(asset, "source/color.tif", *words), words
    assert outcome(asset, "source/color.tif", option.name, "t/inside.tif") == ""
    assert (asset / "t" / "inside.tif").stat().st_size


def word(option: Option, name: str) -> Iterator[str]:
    yield option.name
    yield from (name for _ in option.arguments)


@pytest.mark.parametrize("option", [o for o in OTHERS if o.name not in NOT_HERE], ids=lambda option: option.name)
def test_no_other_option_writes(asset, option):
    """An option that comes to write, and is not declared so, is found here."""
    for name in every_name(asset, "exr", 3, seed=len(option.name)):
        outcome(asset, "source/color.png", *word(option, name), "--pop")


@pytest.mark.parametrize("name", sorted(NOT_HERE))
def test_what_is_left_out_above_is_no_recipes(name):
    words = " ".join(word(LANGUAGE.find(name), "x"))
    with pytest.raises(ParameterError, match=f"{name} cannot be used in a recipe: .*; remove it"):
        require_lines(recipe(f'[[product]]\nname = "t"\nline = "$maps {words} $outputs"\n'))


TILE = '[[product]]\nname = "t"\nline = "$maps --texstationarize:kinds=$kinds'


@pytest.mark.parametrize(
    ("told", "says"),
    [
        (TILE + ' --frames 1-3 $outputs"\n', "--frames cannot be used in a recipe"),
        (TILE + ':variants=3 $outputs"\n', "product t: variants=3 makes several images of each map; add pack=atlas"),
        (TILE + ' $outputs"\n[judge]\nlimits = ["seam>1.5"]\n', "product t does not report 'seam'; add :report="),
        (
            TILE + ':report=$report $outputs"\n[judge]\nlimits = ["sem>1"]\n',
            "unknown measure 'sem', did you mean 'seam'",
        ),
        (TILE + ':report=$report $outputs"\n[judge]\nlimits = ["seam>1", "height_steps>0.05"]\n', ""),
    ],
)
def test_what_would_be_passed_over_in_silence_is_refused(told, says):
    with pytest.raises(ParameterError, match=re.escape(says)) if says else contextlib.nullcontext():
        require_lines(recipe(told))


WRITES = re.compile(
    r"write_text\(|write_bytes\(|open\([^)]*[\"'][wax]|os\.open\(|makedirs\(|\.mkdir\(|np\.save|\.tofile\("
    r"|make_texture\(|os\.link\(|copyfile|\.symlink_to\(|mkstemp|NamedTemporaryFile"
)
# Rooms that no line of a recipe reaches, or that keep what is the user's cache; of modules: standard streams, scratch,
# a temporary folder.
ROOMS = ("library/", "recipes/", "farm/", "live/", "oiiotool/service/", "engine/opencl/")
ELSEWHERE = (
    *ROOMS,
    "engine/io/cache_folders.py",
    "oiiotool/cli/running/streams.py",
    "engine/core/scratch.py",
    "materials/shaded.py",
)


def test_whoever_opens_a_file_does_it_where_the_folder_is_looked_at():
    found = set()
    for package in (Path(oiiotex.__file__).parent, Path(oiiotex_studio.__file__).parent):
        for path in package.rglob("*.py"):
            name, text = path.relative_to(package).as_posix(), path.read_text()
            if WRITES.search(text) and not name.startswith(ELSEWHERE):
                found.add(name)
                door = r"from \.+((engine\.)?io\.)?atomic import|from \.+api\.files import"
                assert name == "engine/io/atomic.py" or re.search(door, text), name
    assert {"engine/io/atomic.py", "engine/io/sealed.py", "oiiotool/cli/files/output.py", "engine/run.py"} <= found


# --- all that leads there ---


MODIFIERS = [
    f"{op.flag()}:{output.asked_by}"
    for op, output in (case.values for case in SIDE_FILES)
    if op.arity({}, 1) == 1 and not op.arguments()
]


def hostile_line(chance: random.Random, asset: Path) -> list[str]:
    """A line that writes outside, by ways of all kinds one upon the other."""
    suffix = chance.choice(SUFFIXES[:2])
    target = chance.choice(leading_out(asset))
    name, before, after = target, [], []
    for _ in range(chance.randrange(4)):
        way = chance.randrange(6)
        if way == 0:
            variable = f"P{len(before)}"
            before, name = [*before, "--set:type=string", variable, name], f"{{{variable}}}"
            if "{" in before[-1]:  # --set takes its text as it is
                before, name = before[:-3], before[-1]
        elif way == 1 and "{" not in name and name[1:]:
            cut = chance.randrange(1, len(name))
            before, name = [*before, "--set:type=string", "Q", name[:cut]], "{Q}" + name[cut:]
        elif way == 2:
            before, after = [*before, "--for", "i", "1"], ["--endfor", *after]
        elif way == 3:
            before, after = [*before, "--if", "1"], ["--endif", *after]
        elif way == 4:
            before = [*before, "--create-dir"]
        else:
            before = [*before, "--dup", "--pop"]
    output = f"{name}.{suffix}"
    writes = chance.choice(
        (
            ["-o", output], ["-otex", output], [f"-o:fileformatname={'openexr' if suffix == 'exr' else 'tiff'}", name],
            ["-o:all=1", output], ["-o:udim=1x1", f"{name}/<UDIM>.{suffix}"], ["--texlab", "-o", output],
            [f"{chance.choice(MODIFIERS)}={output}"], [f'{chance.choice(MODIFIERS)}="{output}"'], ["-obump", output],
        )
    )  # fmt: skip
    return ["source/color.png", "--iscolorspace", "srgb_rec709_scene", *before, *writes, *after]


@pytest.mark.parametrize("seed", range(4))
def test_no_expression_and_no_control_flow_leads_out(asset, seed):
    chance = random.Random(seed)
    for _ in range(15):
        words = hostile_line(chance, asset)
        assert OUTSIDE in outcome(asset, *words), words


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4, 40))
def test_no_expression_and_no_control_flow_leads_out_of_any_line(asset, seed):
    test_no_expression_and_no_control_flow_leads_out(asset, seed)


def test_checkpoints_and_folders_are_held_to_it_too(asset):
    with writing_only_below(asset / "t"):
        with pytest.raises(ParameterError, match=OUTSIDE):
            make_folders(asset / "new")
        kept = Checkpoint(asset / "tile.exr")
        kept.keep("0" * 32, sources.Window(0, 0, 1, 1), np.zeros((1, 1, 3)))
        make_folders(asset / "t" / "new")
    assert sorted(os.listdir(asset)) == ["other", "source", "t"]
    make_folders(asset / "new")  # it ends with the line


# --- before the work ---


@pytest.mark.parametrize(
    "line",
    [
        "$maps --set P /elsewhere/x --texstationarize:report={P}.json $outputs",
        "$maps --set P ../x -o {P}.exr $outputs",
        "$maps --set P ../x --create-dir -o t/{P}/x.exr $outputs",
        "$maps --for i 3 -o t{i}.exr --endfor $outputs",
        "$maps --if {NIMAGES} -o {NIMAGES}.exr --endif $outputs",
        "$maps --set P ~/x.tx -otex {P} $outputs",
    ],
)
def test_what_the_line_alone_shows_is_said_before_the_work(line):
    with pytest.raises(ParameterError, match=f"product t: .*{OUTSIDE}: expected"):
        require_confined(recipe(f'[[product]]\nname = "t"\nline = "{line}"\n'))


@pytest.mark.parametrize(
    "line",
    [
        "$maps --set P t/x -o {P}.exr $outputs",
        "$maps --for i 3 -o t/{i}.exr --endfor $outputs",
        "$maps --if 0 --set P ../x -o t/x.exr --endif --create-dir -o t/sub/x.exr $outputs",
        "$maps -o t/{TOP.width}.exr $outputs",
        "$maps --if {TOP.width<2} -o {NIMAGES}.exr --endif $outputs",  # the run says how wide it is
    ],
)
def test_expressions_within_the_folder_are_no_fault(line):
    told = recipe(f'[[product]]\nname = "t"\nline = "{line}"\n')
    require_confined(told)
    assert require_lines(told) == "t"


def test_nothing_is_left_of_looking_a_recipe_through(tmp_path, monkeypatch: Any):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    require_confined(recipe('[[product]]\nname = "t"\nline = "$maps -o t/x.exr $outputs"\n'))
    assert os.listdir(tmp_path) == []
