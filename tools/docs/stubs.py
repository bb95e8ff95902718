# SPDX-License-Identifier: Apache-2.0
"""The types of the filters' functions from their declarations: `python -m tools.docs.stubs` writes the stub."""

from __future__ import annotations

import inspect
from pathlib import Path

from oiiotex.engine.core.op import Op
from oiiotex.filters import OURS
from oiiotex.python.python_types import Form, docstring, forms, signature

STUB = Path(__file__).parents[2] / "oiiotex" / "filters" / "__init__.pyi"
_HEAD = '''\
# SPDX-License-Identifier: Apache-2.0
# Made by `python -m tools.docs.stubs` from the declarations: change those.
"""The filters as functions."""

from collections.abc import Sequence
from typing import Any, Literal, overload

from OpenImageIO import ROI, ImageBuf

from ..engine.core.op import Op
from ..engine.deferred import Shelf
from ..engine.session import Session
from ..python.python_types import Array, FileName, ImageLike, Picture

SHELVES: tuple[Shelf, ...]
OURS: tuple[type[Op], ...]
FILTERS: tuple[type[Op], ...]

def further() -> tuple[type[Op], ...]: ...
def op_named(name: str) -> type[Op]: ...
'''


def stub_text() -> str:
    """The whole stub."""
    return _HEAD + "".join(_functions(op) for op in sorted(OURS, key=lambda op: op.name))


def _functions(op: type[Op]) -> str:
    ways = forms(op)
    texts = [_function(op, form, False, docstring(op) if n == 0 else "") for n, form in enumerate(ways)]
    texts.append(_function(op, ways[-1], True, ""))
    return "\n" + "".join(f"@overload\n{text}" for text in texts)


def _function(op: type[Op], form: Form, arrays: bool, text: str) -> str:
    words = []
    kinds = inspect.Parameter
    before = kinds.POSITIONAL_ONLY
    shown = signature(op, form, arrays)
    for p in shown.parameters.values():
        if before is kinds.POSITIONAL_ONLY and p.kind is not before:
            words += ["/"] * (len(words) > 0) + ["*"] * (p.kind is kinds.KEYWORD_ONLY)
        default = "" if p.default is p.empty else f" = {p.default!r}"
        words.append(f"{'*' if p.kind is kinds.VAR_POSITIONAL else ''}{p.name}: {p.annotation}{default}")
        before = p.kind
    head = "".join(f"    {word},\n" for word in words)
    body = f'\n    """{_indented(text)}\n    """\n' if text else " ...\n"
    return f"def {op.name}(\n{head}) -> {shown.return_annotation}:{body}"


def _indented(text: str) -> str:
    return text.replace("\\", "\\\\").replace("\n", "\n    ").replace("    \n", "\n")


def main() -> None:
    """Write it."""
    STUB.write_text(stub_text())
    print(STUB)


if __name__ == "__main__":
    main()
