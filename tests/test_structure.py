# SPDX-License-Identifier: Apache-2.0
"""The house's own rules: imports run one way, kernels lie with their rooms, pages follow the declarations."""

from __future__ import annotations

import ast
import functools
import tomllib
from collections.abc import Iterable
from pathlib import Path

import pytest

from oiiotex import filters
from oiiotex.engine.core import access
from oiiotex.engine.core.op import Kind, Op, Output, Space
from oiiotex.oiiotool import host

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "oiiotex"
# A room may import from those before it; what stands in one line with it knows nothing of it.
ORDER = """
errors stats deferred machine
core
io
opencl
session
scan
color
run
superpixels
labels
segmentation
dominant
stationarity
regularity projections drift
patchmatch
wang
quality
exemplar graphcut
quilting multiscale capture atlas fill
charts motion
materials
python_types plugin installed_filters notebook
python_api
filters host
service
cli
api __main__
live farm
recipes
library
""".strip().splitlines()
RANK = {room: rank for rank, line in enumerate(ORDER) for room in line.split()}
KINDS = [kind for kind in vars(access).values() if isinstance(kind, type) and "reach" in vars(kind)]
LATER = {  # what imports a room above it, but not when it is loaded
    ("cli", "farm"), ("cli", "live"),  # a line starts them
    ("session", "color"),  # the config is opened when a line asks for it
    ("core", "session"), ("scan", "color"),  # types alone
}  # fmt: skip
HOLDERS = {"session", "run", "python_api"}  # of sessions, below the ops
LISTS = {"filters"}  # of ops: one file each


def imported_rooms(path: Path, nodes: Iterable[ast.AST]) -> set[str]:
    """Rooms of ours that statements of a module import."""
    package = ["oiiotex", *path.relative_to(PACKAGE).parts[:-1]]
    rooms = set()
    for node in nodes:
        if isinstance(node, ast.ImportFrom) and node.level:
            base = package[: len(package) - node.level + 1]
            target = [*base, *(node.module or "").split(".")]
            names = [target[1]] if len(target) > 1 and target[1] else [alias.name for alias in node.names]
            rooms |= set(names)
    return rooms - {"__version__"}


MODULES = sorted(PACKAGE.rglob("*.py"))
tree_of = functools.cache(lambda path: ast.parse(path.read_text()))


@pytest.fixture(scope="module", autouse=True)
def trees_of_this_module():
    """A million nodes are not left for the garbage collector to look through in all further tests."""
    yield
    tree_of.cache_clear()


def room_of(path: Path) -> str:
    return path.relative_to(PACKAGE).parts[0].removesuffix(".py")


def test_imports_run_one_way():
    """Also those inside functions and for types, but for a few that are named."""
    for path in (path for path in MODULES if room_of(path) not in ("cl", "__init__")):
        room, tree = room_of(path), tree_of(path)
        above = {other for other in imported_rooms(path, ast.walk(tree)) - {room} if RANK[other] >= RANK[room]}
        assert {(room, other) for other in above} <= LATER, path
        assert not above & imported_rooms(path, tree.body), path


STUDIO = {"live", "library", "farm", "recipes"}
SURFACE = {"api", "deferred", "errors"} | STUDIO


@pytest.mark.parametrize("room", sorted(STUDIO))
def test_the_studio_layer_stands_on_the_public_surface(room):
    """So that it could be a distribution of its own."""
    for path in (PACKAGE / room).rglob("*.py"):
        depth = len(path.relative_to(PACKAGE).parts) - 1
        for node in ast.walk(tree_of(path)):  # imports inside functions, too
            if isinstance(node, ast.ImportFrom) and node.level > depth:
                names = [node.module.split(".")[0]] if node.module else [alias.name for alias in node.names]
                assert set(names) <= SURFACE | {"__version__"}, path.name


def test_no_module_imports_the_file_of_an_op():
    """What needs an op asks for it by name: `filters.op_named`. The room's list imports by name, too."""
    files = {op.stem for op in (PACKAGE / "filters").glob("tex*.py")}
    assert len(files) == len(filters.SHELVES)
    for path in MODULES:
        for node in ast.walk(tree_of(path)):
            names = [alias.name for alias in node.names] if isinstance(node, (ast.Import, ast.ImportFrom)) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            assert not files & {word for name in names for word in name.split(".")}, (path, ast.unparse(node))


def test_below_the_ops_nothing_has_a_session():
    """But `compute` and `mapped`, which every op has: they take from it what the functions below need."""
    rooms = [room for room, rank in RANK.items() if rank < RANK["filters"] and room not in HOLDERS]
    below = [path for path in MODULES if room_of(path) in rooms]
    assert len(below) > 100
    for path in below:
        for node in ast.walk(tree_of(path)):
            if isinstance(node, ast.FunctionDef) and node.name not in ("compute", "mapped"):
                assert "session" not in {one.arg for one in (*node.args.args, *node.args.kwonlyargs)}, path
            if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
                assert node.target.id != "session", path


def test_rooms_stay_small_and_say_what_they_are():
    for folder in sorted(p.parent for p in PACKAGE.rglob("__init__.py") if p.parent not in (PACKAGE, PACKAGE / "cl")):
        files = [p for p in folder.glob("*.py") if p.name != "__init__.py"]
        assert (folder / "README.md").read_text().startswith("# "), folder.name
        if folder.name not in LISTS:
            assert len(files) <= 12, folder.name
            assert sum(len(p.read_text().splitlines()) for p in files) <= 2500, folder.name


def test_the_wheel_holds_every_room():
    packages = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]["packages"]
    rooms = {".".join(path.parent.relative_to(ROOT).parts) for path in PACKAGE.rglob("__init__.py")}
    assert set(packages) == rooms | {"oiiotex.ocio", "oiiotex.howto"}


def test_modules_stay_small_and_say_their_license():
    for path in (*MODULES, *(ROOT / "tests").rglob("*.py")):
        lines = path.read_text().splitlines()
        assert len(lines) <= 400, path
        # REUSE-IgnoreStart
        assert lines[0] == "# SPDX-License-Identifier: Apache-2.0", path
        # REUSE-IgnoreEnd


def test_a_type_has_a_name_of_its_own():
    """Classes and aliases of types; those of host ops are called as oiiotool's options."""
    places: dict[str, set[str]] = {}
    for path in (p for p in MODULES if room_of(p) != "host"):
        for node in tree_of(path).body:
            names = [node.name] if isinstance(node, ast.ClassDef) else []
            if isinstance(node, ast.Assign) and "TypeVar(" not in ast.unparse(node.value):
                names = [target.id for target in node.targets if isinstance(target, ast.Name)]
            for name in names:
                if name[0].isupper() and not name.isupper():
                    places.setdefault(name, set()).add(str(path.relative_to(PACKAGE)))
    assert {name: sorted(found) for name, found in places.items() if len(found) > 1} == {}


def test_kernel_names_start_with_their_file():
    for path in (PACKAGE / "cl").glob("*.cl"):
        names = [
            line.split("(")[0].split()[-1] for line in path.read_text().splitlines() if line.startswith("__kernel")
        ]
        assert names and all(name.startswith(f"{path.stem}_") for name in names)


def test_an_op_is_of_one_access_kind_and_says_no_more_of_it():
    facts = {"name": "forgetful", "space": Space.ANY, "outputs": (Output("out", Kind.PIXELS, ""),)}
    for bases, said in (((Op,), {}), ((access.Pointwise,), {"reach": "looks at nothing"})):
        with pytest.raises(TypeError, match="access kind"):
            type("Forgetful", bases, facts | said)
    for op in (*filters.FILTERS, *host.OPS):
        assert sum(issubclass(op, kind) for kind in KINDS) == 1, op.name


@pytest.mark.parametrize("op", filters.OURS, ids=lambda op: op.name)
def test_the_docs_page_is_made_from_the_declaration(op):
    from tools.docs.pages import page_text

    path = ROOT / "docs" / "reference" / "filters" / f"tex{op.name}.md"
    assert path.read_text() == page_text(op, path), "run make docs"


def test_the_page_of_the_chain_is_made_from_the_declarations():
    from tools.docs.pages import language_text

    assert (ROOT / "docs" / "reference" / "chain.md").read_text() == language_text(), "run make docs"
