# SPDX-License-Identifier: Apache-2.0
"""Every declared number, size and place at its extremes, on small images, in a process that is watched."""

from __future__ import annotations

import os
import resource
import time
from collections.abc import Iterator
from pathlib import Path

from oiiotex.engine.core.op import Op
from oiiotex.engine.core.parameters import Numbers, Parameter, Size
from oiiotex.engine.deferred import oiio
from oiiotex.engine.errors import Error
from oiiotex.oiiotool.cli.running.line_run import run
from tests import forked

NUMBERS = (
    "2147483648", "nan", "1e308", "0", "-1", "1e-9", "2147483647", "-2147483649", "9223372036854775808", "inf",
    "-1e308",
)  # fmt: skip
SIZES = (
    "46341x46341", "999999999x999999999", "99999x99999", "0x0", "-1x-1", "1x2147483647", "2147483647x1",
    "2147483648x2147483648", "30001x30001", "1x999999999", "999999999x1", "1e308x1e308", "nanxnan", "infx1",
)  # fmt: skip
PLACES = (
    "10x10+2147483647+0", "+2147483647+0", "+0-2147483648", "10x10-2147483648+0", "10x10+0+9223372036854775808",
    "2147483647,0,2147483647,0", "0,0,2147483647,2147483647", "-2147483648,-2147483648,2147483647,2147483647",
    "2147483647,2147483647", "1000000%", "1e308%", "1e30", "0%", "999999999",
)  # fmt: skip
SHORT = {*NUMBERS[:3], *SIZES[:3], *PLACES[:2]}  # of every kind those that have done harm
_GEOMETRY = {"size", "place", "offset", "shift", "position", "corners", "points", "from", "to"}
_WORDS = {
    "size": "8x8", "channels": "3", "pattern": "noise", "kernel": "gaussian", "position": "+0+0",
    "matrix": "1,0,0,0,1,0,0,0,1", "corners": "0,0,4,4", "points": "0,0,4,4",
}  # fmt: skip
CACHE = 64  # MB
_MOST_MB = 700  # that a line may add to what the process held before: the budget, libraries, an OpenCL runtime


def values(parameter: Parameter) -> Iterator[str]:
    """What is tried of it."""
    kinds = parameter.kind or ()
    if {int, float, Numbers} & set(kinds):
        yield from NUMBERS
    if Numbers in kinds:
        yield from (
            ",".join([value] * n) for n in (2, 3, 4, 8, 9) for value in ("1e308", "-1e38", "1e30", "0", "1e-30")
        )
    if Size in kinds or parameter.name in _GEOMETRY:
        yield from SIZES
    if parameter.name in _GEOMETRY and str in kinds:
        yield from PLACES


def lines(op: type[Op], short: bool) -> list[list[str]]:
    """The lines that try an op: the short ones, or all others."""
    words = {a.name: _WORDS.get(a.name, "1") for a in op.arguments()}
    many = any(image.many for image in op.images())
    images = ["a.exr" if op.prefix == "--" else "photo.exr"] * (2 if many else len(op.images()))
    tried = []
    for parameter in op.parameters():
        for value in values(parameter):
            if short != (value in SHORT and parameter.name != "seed"):  # of those most are right, and long work
                continue
            given = [*(words | {parameter.name: value} if parameter.positional else words).values()]
            flag = op.flag() if parameter.positional else f"{op.flag()}:{parameter.name}={value}"
            tried.append([*images, flag, *given, "--cache", str(CACHE), "-q", "-o", "o.exr"])
    return tried


def try_all(op: type[Op], folder: Path, *, short: bool, seconds: float) -> None:
    """Run its lines in a fork: each is done or refused in one line of text, soon, and in little memory.

    Raises
    ------
    AssertionError
        With the line.
    """
    process = forked.FORKS.Process(target=_lines, args=(lines(op, short), str(folder), seconds))
    process.start()
    process.join(120 if short else 1000)
    late = process.is_alive()
    if late:
        process.kill()
        process.join()
    report = (folder / "report").read_text()
    last, _, cpu = report.splitlines()[-1].partition(" ")
    assert (process.exitcode, last) == (0, "all"), report[-1000:]
    forked.spent += float(cpu)


def _lines(tried: list[list[str]], folder: str, seconds: float) -> None:
    os.chdir(folder)
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    oiio.attribute("limits:imagesize_MB", 16 * CACHE)
    with open("report", "w", buffering=1) as report:
        for words in tried:
            held, begun = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, time.monotonic()
            report.write(" ".join(words) + "\n")
            try:
                run(words)
            except Error as error:
                assert str(error).isprintable(), str(error)
            except BaseException as error:
                report.write(f"{type(error).__name__}: {error}\n")
                os._exit(1)
            grown = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - held) >> 10
            if time.monotonic() - begun > seconds or grown > _MOST_MB:
                report.write(f"{time.monotonic() - begun:.1f} s, {grown} MB\n")
                os._exit(1)
        report.write(f"all {sum(os.times()[:4])}\n")
    os._exit(0)
