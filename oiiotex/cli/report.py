# SPDX-License-Identifier: Apache-2.0
"""What a user sees of a run: help, versions, devices, progress, where the time went."""

from __future__ import annotations

import sys
import textwrap

from .. import __version__
from ..errors import ParameterError
from ..filters import FILTERS
from ..op import Op
from ..params import Parameter, nearest
from ..session import Progress
from ..stats import Stats
from .language import LANGUAGE

_USAGE = """\
oiiotex: texture filters in an oiiotool-style chain
usage: oiiotex photo.exr --iscolorspace ACEScg --texstationarize:sigma=32:size=1024x1024 -o tile.exr
"""


def overview() -> str:
    """The text of --help: our filters first."""
    rows = [(op.flag(), summary(op)) for op in FILTERS]
    options = [(" ".join((o.name, *o.arguments)), o.help) for o in LANGUAGE.options]
    table = "\n".join(f"  {name:24s} {text}" for name, text in rows)
    others = "\n".join(f"  {name:24s} {text}" for name, text in options)
    return f"{_USAGE}\nTexture filters (--help NAME prints a filter's page):\n{table}\n\nOptions:\n{others}"


def page(name: str) -> str:
    """A filter's page.

    Raises
    ------
    ParameterError
        There is no filter of that name.
    """
    pages = {op.name: op for op in FILTERS}
    bare = name.lstrip("-").removeprefix("tex")
    if bare not in pages:
        raise ParameterError(
            f"no filter '{name}'{nearest(bare, pages)}; there is {', '.join(op.flag() for op in FILTERS)}"
        )
    op = pages[bare]
    images = " ".join(i.name for i in op.images())
    lines = [
        f"{op.flag()}  ({images} -> {', '.join(o.name for o in op.outputs)})",
        "",
        description(op),
        "",
        "Modifiers:",
    ]
    lines += [_modifier(p) for p in op.parameters()] or ["  none"]
    lines += ["", "Outputs:", *(f"  {o.name:12s} {o.help}" for o in op.outputs)]
    lines += ["", f"Works in {op.space.value}; looks at {op.reach.value}."]
    return "\n".join(lines)


def summary(op: type[Op]) -> str:
    """The first line of an op's docstring."""
    return description(op).splitlines()[0].rstrip(".")


def description(op: type[Op]) -> str:
    """An op's docstring."""
    head, _, rest = (op.__doc__ or "").partition("\n")
    return f"{head}\n{textwrap.dedent(rest)}".strip()


def _modifier(p: Parameter) -> str:
    default = "" if p.default is None else f" [{_word(p.default)}]"
    text = textwrap.fill(f"{p.help}; {p.allowed()}{default}", 110, initial_indent=" " * 15, subsequent_indent=" " * 15)
    return f"  :{p.name:12s}{text[15:]}"


def _word(value: object) -> str:
    return str(int(value)) if isinstance(value, bool) else str(value)


def versions() -> str:
    """Ours and those of what we stand on."""
    import OpenImageIO as oiio
    import PyOpenColorIO as ocio

    return f"oiiotex {__version__}, OpenImageIO {oiio.__version__}, OpenColorIO {ocio.__version__}"


def device_list(threads: int) -> str:
    """One line per OpenCL device."""
    from .. import device

    found = device.devices(threads)
    lines = [f"{d.number}: {d.name} ({d.kind}), {d.platform}, {d.version}, {d.memory >> 20} MB" for d in found]
    return (
        "\n".join(lines) or "no OpenCL device: install a GPU driver, or a CPU runtime with 'pip install oiiotex[cpu]'"
    )


def progress_bar() -> Progress | None:
    """A bar on a terminal; nothing in a pipe."""
    if not sys.stderr.isatty():
        return None
    from tqdm import tqdm

    bar: tqdm | None = None

    def advance(done: int, total: int) -> None:
        nonlocal bar
        if bar is None:
            bar = tqdm(total=total, leave=False, unit="it")
        bar.update(done - bar.n)
        if done == total:
            bar.close()
            bar = None

    return advance


def time_table(stats: Stats, wall: float) -> str:
    """The text of --runstats."""
    rows = [f"  {name:28s} {seconds:8.3f} s {stats.calls[name]:6d} x" for name, seconds in stats.seconds.items()]
    return "\n".join([f"time: {wall:.3f} s", *rows])
