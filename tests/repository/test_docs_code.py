# SPDX-License-Identifier: Apache-2.0
"""Python that the docs show runs, and the modules of the checkout that they name are programs.

Lines of the command line are parsed by tests/oiiotool/test_words.py.
"""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path

import pytest

from tests import pictures
from tests.conftest import save

ROOT = Path(__file__).parents[2]
TEXTS = {
    str(path.relative_to(ROOT)): path.read_text()
    for path in sorted(
        [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *ROOT.glob("docs/**/*.md"), *ROOT.glob("benchmarks/**/*.md")]
    )
}
BLOCKS = {name: re.findall(r"```python\n(.*?)```", text, re.DOTALL) for name, text in TEXTS.items()}
ELSEWHERE = {  # run by a test that knows what comes out
    "docs/reference/python.md": "oiiotool/test_python.py",
    "docs/reference/filters/texlabel.md": "analysis/test_label_docs.py",
    "docs/how-to/your_own_filter.md": "oiiotool/test_plugins.py",
}
OF_HOSTS = ("docs/how-to/hosts.md",)  # need a plugin that is built, and Blender: their syntax alone
LARGE = "size=(1024, 1024)"  # takes seconds


def shown() -> list[str]:
    return [name for name, blocks in BLOCKS.items() if blocks]


@pytest.mark.parametrize("page", shown())
def test_python_of_a_page_runs(page, tmp_path, monkeypatch):
    code = "\n".join(BLOCKS[page])
    if page in ELSEWHERE:
        assert Path(page).name in (ROOT / "tests" / ELSEWHERE[page]).read_text()
    program = compile(code.replace(LARGE, "size=(96, 96)"), page, "exec")
    if page not in ELSEWHERE and page not in OF_HOSTS:
        save(pictures.stained(pictures.bricks(80, 96, seed=1)), tmp_path / "photo.png")
        monkeypatch.chdir(tmp_path)
        exec(program, {})


def modules() -> set[tuple[str, str]]:
    """Pages, and what they run by `python -m` of the checkout."""
    named = r"python -m ((?:benchmarks|tools|tests)(?:\.\w+)*|pytest [\w/.]+\.py)(?![\w.])"
    return {(page, name) for page, text in TEXTS.items() for name in re.findall(named, text)}


@pytest.mark.parametrize(("page", "module"), sorted(modules()))
def test_every_module_that_a_page_names_is_a_program(page, module):
    name, _, words = module.partition(" ")
    if name == "pytest":
        assert (ROOT / words).exists()
        return
    path = importlib.util.find_spec(name)
    assert path is not None, f"{page}: there is no {name}"
    if path.submodule_search_locations:  # a package
        path = importlib.util.find_spec(f"{name}.__main__")
    assert '__name__ == "__main__"' in Path(path.origin).read_text()
