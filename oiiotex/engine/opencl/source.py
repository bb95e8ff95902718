# SPDX-License-Identifier: Apache-2.0
"""Kernel sources for the compiler: one string with headers inlined.

No include folder is passed to a compiler: runtimes split build options at spaces, and folder names may have spaces.
`#line` keeps the line numbers in a compiler's messages correct.
"""

from __future__ import annotations

import re
from importlib import resources

_INCLUDE = re.compile(r'#include "(\w+\.h)"')


def expanded(text: str, name: str, seen: set[str] | None = None) -> str:
    """The source of file `name` in cl/, with each header inlined at its first include."""
    seen = set() if seen is None else seen
    lines = [f'#line 1 "{name}"']
    for number, line in enumerate(text.splitlines(), 1):
        match = _INCLUDE.match(line)
        if match is None:
            lines.append(line)
        elif match[1] not in seen:
            seen.add(match[1])
            header = (resources.files("oiiotex") / "cl" / match[1]).read_text()
            lines += [expanded(header, match[1], seen), f'#line {number + 1} "{name}"']
        else:
            lines.append("")
    return "\n".join(lines) + "\n"


def kernel_source(stem: str) -> str:
    """The source of cl/<stem>.cl with its headers."""
    name = f"{stem}.cl"
    return expanded((resources.files("oiiotex") / "cl" / name).read_text(), name)
