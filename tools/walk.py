# SPDX-License-Identifier: Apache-2.0
"""Print how far one must walk through the code to follow a command line from its start to its end.

    python -m tools.walk photo.png --texstationarize -o tile.png

functions: our functions, lambdas and generators that the line enters, each counted once. Class bodies and modules do
not count. returns: in the order in which these functions are entered for the first time, how often the file changes to
one that was left before. Files of compiled kernels and cached results change neither, if a line is run twice.
"""

from __future__ import annotations

import inspect
import sys
import threading
from collections.abc import Iterable
from pathlib import Path
from types import CodeType, FrameType

import oiiotex

_OWN = str(Path(oiiotex.__file__).parent)


def entered(words: list[str]) -> list[CodeType]:
    """Our functions that a command line enters, on all threads, in the order of the first time."""
    found: dict[CodeType, None] = {}

    def note(frame: FrameType, event: str, _: object) -> None:
        code = frame.f_code
        if event == "call" and code.co_flags & inspect.CO_OPTIMIZED and code.co_filename.startswith(_OWN):
            found.setdefault(code)

    threading.setprofile(note)
    sys.setprofile(note)
    try:
        from oiiotex.oiiotool.cli.main import main

        main(words)
    except SystemExit as ended:
        if ended.code:
            raise
    finally:
        sys.setprofile(None)
        threading.setprofile(None)
    return list(found)


def returns(files: Iterable[str]) -> int:
    """How often the file changes to one that was left before."""
    count, left, here = 0, set[str](), ""
    for file in files:
        if file != here:
            count += file in left
            left.add(here)
            here = file
    return count


def main() -> None:
    """Run the line of the arguments, and print both numbers."""
    walk = entered(sys.argv[1:])
    print(f"{len(walk)} functions, {returns(code.co_filename for code in walk)} returns to a file left before")


if __name__ == "__main__":
    main()
