# SPDX-License-Identifier: Apache-2.0
"""The house's own rules: imports run one way, kernels lie with their rooms, pages follow the declarations."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

from oiiotex import filters
from oiiotex.op import Op, Output, Reach, Space

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "oiiotex"
# each may import from its own floor and from those below it
FLOORS = [
    {"errors", "stats", "windows"},
    {"temporary"},
    {"kept"},
    {"params", "text_values", "__init__"},
    {"op"},
    {"opencl_runtime"},
    {"device", "images", "keeping"},
    {"tiles"},
    {"files", "color", "cryptomatte"},
    {"formats"},
    {"writing"},
    {"session"},
    {"working"},
    {"analysis"},
    {"synthesis"},
    {"filters", "host"},
    {"cli"},
]


def floor_of(module: str) -> int:
    return next(i for i, rooms in enumerate(FLOORS) if module in rooms)


def imported_rooms(path: Path) -> set[str]:
    """Rooms of ours that a module imports when it is loaded (imports inside functions and for typing are later)."""
    package = ["oiiotex", *path.relative_to(PACKAGE).parts[:-1]]
    rooms = set()
    for node in ast.parse(path.read_text()).body:
        if isinstance(node, ast.ImportFrom) and node.level:
            base = package[: len(package) - node.level + 1]
            target = [*base, *(node.module or "").split(".")]
            names = [target[1]] if len(target) > 1 and target[1] else [alias.name for alias in node.names]
            rooms |= set(names)
    return rooms - {"__version__"}


@pytest.mark.parametrize("path", sorted(PACKAGE.rglob("*.py")), ids=lambda p: str(p.relative_to(PACKAGE)))
def test_imports_run_one_way(path):
    room = path.relative_to(PACKAGE).parts[0].removesuffix(".py")
    if room == "cl":
        return
    for other in imported_rooms(path):
        assert floor_of(other) <= floor_of(room), f"{room} imports {other}"


@pytest.mark.parametrize("path", sorted(PACKAGE.rglob("*.py")), ids=lambda p: str(p.relative_to(PACKAGE)))
def test_modules_stay_small_and_say_their_licence(path):
    lines = path.read_text().splitlines()
    assert len(lines) <= 400
    assert lines[0] == "# SPDX-License-Identifier: Apache-2.0"


def test_kernel_names_start_with_their_file():
    for path in (PACKAGE / "cl").glob("*.cl"):
        names = [
            line.split("(")[0].split()[-1] for line in path.read_text().splitlines() if line.startswith("__kernel")
        ]
        assert names and all(name.startswith(f"{path.stem}_") for name in names)


def test_an_op_must_declare_its_reach():
    with pytest.raises(TypeError, match="reach"):
        type("Forgetful", (Op,), {"name": "forgetful", "space": Space.ANY, "outputs": (Output("out", ""),)})
    assert all(isinstance(op.reach, Reach) for op in filters.FILTERS)


@pytest.mark.parametrize("op", filters.FILTERS, ids=lambda op: op.name)
def test_the_docs_page_is_made_from_the_declaration(op):
    from docs.pages import page_text

    path = ROOT / "docs" / f"tex{op.name}.md"
    assert path.read_text() == page_text(op, path), "run make docs"


def test_the_page_of_the_chain_is_made_from_the_declarations():
    from docs.pages import language_text

    assert (ROOT / "docs" / "chain.md").read_text() == language_text(), "run make docs"
