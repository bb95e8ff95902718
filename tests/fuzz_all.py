# SPDX-License-Identifier: Apache-2.0
"""Fuzzing by time: `python -m tests.fuzz_all --minutes 10` breaks every kind of input in turn until the time is over.

Lines, image files, documents, names in documents, and messages to the resident process and to the page's server. The
numbers of the cases follow from the date, so that every day tries others; `--begin` repeats those of another day. The
exit status is 1 if a case failed.
"""

from __future__ import annotations

import argparse
import os
import re
import subprocess
import sys
import time
from collections.abc import Iterator

_ROUND = 200  # cases of a target before the next one has its turn
_GOOD = re.compile(r"\d+ of \d+ after \d+ s|.*: \d+ read, 0 wrong|\d+ passed.*")


def targets(begin: int) -> dict[str, list[str]]:
    """The commands of a round, by target."""
    return {
        "lines": ["tests.fuzz", "lines", str(_ROUND), "--begin", str(begin)],
        "files": ["tests.fuzz", "files", str(_ROUND), "--begin", str(begin)],
        "documents": ["tests.fuzz_documents", str(_ROUND), "--begin", str(begin)],
        "names": ["tests.fuzz_names", str(_ROUND), "--begin", str(begin)],
        "messages": [
            "pytest",
            "-q",
            "-p",
            "no:cacheprovider",
            "-m",
            "not slow",
            "tests/oiiotool/test_strange_messages.py",
        ],
    }


def faults(words: list[str], begin: int) -> list[str]:
    """Run a target: the lines that it prints about failed cases."""
    there = os.environ | {"OIIOTEX_STRANGE": str(_ROUND), "OIIOTEX_STRANGE_BEGIN": str(begin)}
    command = [sys.executable, "-m", *words]
    done = subprocess.run(command, env=there, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    told = [line for line in done.stdout.splitlines() if line.strip() and not _GOOD.fullmatch(line)]
    return told if done.returncode or words[0] != "pytest" else []


def rounds(begin: int, minutes: float) -> Iterator[tuple[str, int, list[str]]]:
    """(target, first number, failures) of every run that begins before the time is over."""
    end = time.monotonic() + 60 * minutes
    while True:
        for name, words in targets(begin).items():
            if time.monotonic() > end:
                return
            yield name, begin, faults(words, begin)
        begin += _ROUND


def main() -> None:
    """Run, print a line for each run, and the failures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=10)
    parser.add_argument("--begin", type=int, default=int(time.time() // 86400) * 100_000, help="the first number")
    given = parser.parse_args()
    failed = False
    for name, first, told in rounds(given.begin, given.minutes):
        print(f"{name} from {first}: {len(told)} lines about failures", *told, sep="\n", flush=True)
        failed = failed or bool(told)
    sys.exit(failed)


if __name__ == "__main__":
    main()
