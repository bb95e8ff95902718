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

ROOT = Path(__file__).parents[2]
PACKAGE = ROOT / "oiiotex"
FLOORS = ("cl", "engine", "analysis", "synthesis", "surfaces", "python", "filters", "oiiotool")  # from the bottom up
MODULES = sorted(PACKAGE.rglob("*.py"))
STUDIO = sorted((ROOT / "studio" / "oiiotex_studio").rglob("*.py"))
KINDS = [kind for kind in vars(access).values() if isinstance(kind, type) and "reach" in vars(kind)]
HOLDERS = {"engine/session", "engine/run.py", "python/python_api.py"}  # of sessions, below the ops
LATER = {("core", "session"), ("session", "color"), ("scan", "color")}  # types, or when a line asks for it
PUBLIC = {"oiiotex", "oiiotex.engine.errors", "oiiotex.engine.deferred"}  # for all of the studio

tree_of = functools.cache(lambda path: ast.parse(path.read_text()))


@pytest.fixture(scope="module", autouse=True)
def trees_of_this_module():
    """A million nodes are not left for the garbage collector to look through in all further tests."""
    yield
    tree_of.cache_clear()


def imported(path: Path, nodes: Iterable[ast.AST]) -> set[str]:
    """Dotted names of what statements of a module import: modules, and names in modules."""
    package = path.relative_to(ROOT / "studio" if path in STUDIO else ROOT).parts[:-1]
    names = set()
    for node in nodes:
        if isinstance(node, ast.ImportFrom):
            base = [*package[: len(package) - node.level + 1]] if node.level else []
            base += node.module.split(".") if node.module else []
            names |= {".".join((*base, alias.name)) for alias in node.names}
        elif isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
    return names


def floor_of(path: Path) -> str:
    return path.relative_to(PACKAGE).parts[0].removesuffix(".py")


def room_of(path: Path) -> str:
    """The package on a floor, or the module that lies there alone."""
    return "/".join(path.relative_to(PACKAGE).parts[:2])


def test_imports_run_downward_from_floor_to_floor():
    """Also those inside functions and for types."""
    for path in (path for path in MODULES if floor_of(path) in FLOORS):
        below = FLOORS[: FLOORS.index(floor_of(path)) + 1]
        names = {name.split(".")[1] for name in imported(path, ast.walk(tree_of(path))) if name.startswith("oiiotex.")}
        assert names <= {*below, "__version__"}, path


def test_the_core_does_not_know_the_studio():
    for path in MODULES:
        assert not {name for name in imported(path, ast.walk(tree_of(path))) if name.startswith("oiiotex_studio")}, path


def test_the_studio_takes_what_it_needs_of_the_core_by_its_api():
    """`api` is the only door, besides errors and deferred libraries."""
    for path in (path for path in STUDIO if path.parent.name != "api"):
        names = {name for name in imported(path, ast.walk(tree_of(path))) if name.startswith("oiiotex.")}
        assert {name.rpartition(".")[0] for name in names} <= PUBLIC, path


def circles(arrows: dict[str, set[str]]) -> set[str]:
    """What lies on a circle of arrows, or leads to one."""
    left = {place: set(others) for place, others in arrows.items()}
    while ends := {place for place, others in left.items() if not others & left.keys()}:
        left = {place: others for place, others in left.items() if place not in ends}
    return set(left)


def test_packages_of_a_floor_form_no_circle():
    assert circles({"a": {"b"}, "b": {"c"}, "c": {"b"}, "d": set()}) == {"a", "b", "c"}
    for floor in FLOORS:
        arrows: dict[str, set[str]] = {}
        for path in (path for path in MODULES if floor_of(path) == floor and len(path.relative_to(PACKAGE).parts) > 1):
            room = room_of(path).split("/")[1].removesuffix(".py")
            names = imported(path, ast.walk(tree_of(path)))
            others = {name.split(".")[2] for name in names if name.startswith(f"oiiotex.{floor}.")} - {room}
            arrows.setdefault(room, set()).update(other for other in others if (room, other) not in LATER)
        assert not circles(arrows), floor


def dotted(path: Path) -> str:
    """The name by which a module is imported."""
    parts = path.relative_to(ROOT / "studio" if path in STUDIO else ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if path.name == "__init__.py" else parts)


def test_modules_form_no_circle():
    """Also not by imports inside functions and for types."""
    modules = {dotted(path): path for path in (*MODULES, *STUDIO)}
    arrows = {}
    for name, path in modules.items():
        names = imported(path, ast.walk(tree_of(path)))
        arrows[name] = {one if one in modules else one.rpartition(".")[0] for one in names} & modules.keys() - {name}
    assert ("oiiotex.engine.run" in arrows["oiiotex.oiiotool.cli.stack.chain"]) and len(arrows) > 400
    assert not circles(arrows)


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
    """But `make` and `mapped`, which every op has: they take from it what the functions below need."""
    floors = FLOORS[: FLOORS.index("filters")]
    below = [path for path in MODULES if floor_of(path) in floors and room_of(path) not in HOLDERS]
    assert len(below) > 100
    for path in below:
        for node in ast.walk(tree_of(path)):
            if isinstance(node, ast.FunctionDef) and node.name not in ("make", "mapped"):
                assert "session" not in {one.arg for one in (*node.args.args, *node.args.kwonlyargs)}, path
            if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
                assert node.target.id != "session", path


def test_packages_say_what_they_are():
    for path in (path for path in (*MODULES, *STUDIO) if path.name == "__init__.py" and path.parent != PACKAGE):
        assert (path.parent / "README.md").read_text().startswith("# "), path.parent


def test_the_wheels_hold_every_package():
    for place, paths, further in (
        (ROOT, MODULES, {"oiiotex.ocio", "oiiotex.howto"}), (ROOT / "studio", STUDIO, set()),
    ):  # fmt: skip
        packages = tomllib.loads((place / "pyproject.toml").read_text())["tool"]["setuptools"]["packages"]
        folders = {".".join(path.parent.relative_to(place).parts) for path in paths if path.name == "__init__.py"}
        assert set(packages) == folders | further


def test_modules_stay_small_and_say_their_license():
    for path in (*MODULES, *STUDIO, *(ROOT / "tests").rglob("*.py")):
        lines = path.read_text().splitlines()
        assert len(lines) <= 400, path
        # REUSE-IgnoreStart
        assert lines[0] == "# SPDX-License-Identifier: Apache-2.0", path
        # REUSE-IgnoreEnd


def test_a_type_has_a_name_of_its_own():
    """Classes and aliases of types; those of host ops are called as oiiotool's options."""
    places: dict[str, set[str]] = {}
    for path in (p for p in MODULES if room_of(p) != "oiiotool/host"):
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
    from tools.docs.pages import FOLDER, SHARED, language_text, shared_text

    assert (FOLDER / "filters" / SHARED).read_text() == shared_text(), "run make docs"

    assert (ROOT / "docs" / "reference" / "chain.md").read_text() == language_text(), "run make docs"
