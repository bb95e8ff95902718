# SPDX-License-Identifier: Apache-2.0
"""What a user sees of a run: help, versions, devices, progress, where the time went."""

from __future__ import annotations

import sys
import textwrap

from .. import __version__
from ..errors import DeviceError, ParameterError
from ..op import Op
from ..params import Parameter, declared
from ..session import Progress
from ..stats import Stats
from .language import LANGUAGE
from .parse import Option, Refused

_USAGE = """\
oiiotex: texture filters in an oiiotool-style chain
usage: oiiotex photo.exr --iscolorspace ACEScg --texstationarize:sigma=32:size=1024x1024 -o tile.exr
"""


def overview() -> str:
    """The text of --help: our filters first."""
    lines = [_USAGE]
    for heading, ops in LANGUAGE.ops.items():
        lines += [f"{heading}:", *(_row(_call(op), summary(op)) for op in ops), ""]
    for heading, options in LANGUAGE.groups.items():
        lines += [f"{heading}:", *(_row(" ".join((o.name, *o.arguments)), o.help) for o in options), ""]
    return "\n".join(lines).rstrip()


def _call(op: type[Op]) -> str:
    return " ".join((op.flag(), *(p.name.upper() for p in op.arguments())))


def _row(name: str, text: str) -> str:
    return f"  {name:28s} {text}" if len(name) <= 28 else f"  {name}\n{' ' * 31}{text}"


def page(name: str) -> str:
    """The page of an op or an option.

    Raises
    ------
    ParameterError
        There is none of that name.
    """
    try:  # a bare name means the filter first: there is a --warp of the host, and a --texwarp
        found = LANGUAGE.find(name if name.startswith("-") else f"--tex{name}")
    except ParameterError:
        found = LANGUAGE.find(name if name.startswith("-") else f"--{name}")
    if isinstance(found, Refused):
        return f"{found.name} of oiiotool is not here: {found.reason}"
    if isinstance(found, Option):
        lines = [" ".join((found.name, *found.arguments)), "", found.help]
        if found.modifiers is not None:
            lines += ["", "Modifiers:", *map(_modifier, declared(found.modifiers)[1])]
        return "\n".join(lines)
    return _op_page(found)


def _op_page(op: type[Op]) -> str:
    images = " ".join(i.name for i in op.images())
    further = op.further_images()
    images += f" {further.name}" if further else ""
    lines = [f"{_call(op)}  ({images} -> {', '.join(o.name for o in op.outputs)})", "", description(op)]
    if op.arguments():
        lines += ["", "Arguments:", *(f"  {p.name.upper():13s}{p.help}; {p.allowed()}" for p in op.arguments())]
    lines += ["", "Modifiers:", *([_modifier(p) for p in op.modifiers()] or ["  none"])]
    if len(op.outputs) > 1 or op.prefix == Op.prefix:
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


def versions(device_name: str | None, threads: int) -> str:
    """Ours, and those of what we stand on."""
    import OpenImageIO as oiio
    import PyOpenColorIO as ocio

    from .. import device

    try:
        info = device.choose(device_name, threads)
        used = f"{info.name} ({info.kind}), {info.platform}, {info.version}"
    except DeviceError as error:
        used = str(error)
    inside = ".".join(str(oiio.OpenColorIO_version_hex >> shift & 0xFF) for shift in (24, 16, 8))
    return "\n".join(
        (
            f"oiiotex {__version__}",
            f"OpenImageIO {oiio.__version__} (with OpenColorIO {inside})",
            f"OpenColorIO {ocio.__version__}",
            f"device: {used}",
        )
    )


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


# --- completion ---

_BASH = """\
_oiiotex() {{
  local line="${{COMP_LINE:0:COMP_POINT}}"
  local word="${{line##* }}"
  COMPREPLY=()
  case "$word" in
    -*:*)
      compopt -o nospace 2>/dev/null
      case "${{word%%:*}}" in
{modifiers}
      esac ;;
    -*) COMPREPLY=($(compgen -W "{options}" -- "$word")) ;;
    *) COMPREPLY=($(compgen -f -- "$word")) ;;
  esac
}}
complete -o filenames -F _oiiotex oiiotex"""


def completion(shell: str) -> str:
    """A script for the shell that completes options, modifiers and files.

    Raises
    ------
    ParameterError
        It is for a shell that we have none for.
    """
    if shell not in ("bash", "zsh"):
        raise ParameterError(f"--completion {shell}: allowed is bash or zsh")
    names = {op.flag(): [p.name for p in op.modifiers()] for ops in LANGUAGE.ops.values() for op in ops}
    names |= {o.name: [p.name for p in declared(o.modifiers)[1]] if o.modifiers else [] for o in LANGUAGE.options}
    rows = [
        f"""        {name}) COMPREPLY=($(compgen -W "{" ".join(f"{m}=" for m in modifiers)}" -- "${{word##*:}}")) ;;"""
        for name, modifiers in names.items()
        if modifiers
    ]
    script = _BASH.format(modifiers="\n".join(rows), options=" ".join(names))
    return script if shell == "bash" else f"autoload -U +X bashcompinit && bashcompinit\n{script}"
