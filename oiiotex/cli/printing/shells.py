# SPDX-License-Identifier: Apache-2.0
"""What shells and `man` want to know of the program: written from the declarations."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from ... import __version__
from ...core.op import Op
from ...core.parameters import Parameter
from ...errors import ParameterError
from ..language.parse import Option
from ..vocabulary import LANGUAGE
from .report import call, description, summary

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

_FISH = """\
function __oiiotex_modifiers
    set -l word (commandline -ct)
    string match -qr '^-[^:]*:' -- $word; or return
    set -l begun (string replace -r '[^:]*$' '' -- $word)
    switch (string split -m1 : -- $word)[1]
{modifiers}
    end
end
complete -c oiiotex -a '(__oiiotex_modifiers)'
{options}"""


def completion(shell: str) -> str:
    """A script for the shell that completes options, modifiers and files."""
    if shell == "fish":
        return _fish()
    if shell not in ("bash", "zsh"):
        raise ParameterError(f"--completion {shell}: allowed is bash, zsh or fish")
    names = {flag: [p.name for p in modifiers] for flag, _, _, modifiers in declarations()}
    rows = [
        f"""        {name}) COMPREPLY=($(compgen -W "{" ".join(f"{m}=" for m in modifiers)}" -- "${{word##*:}}")) ;;"""
        for name, modifiers in names.items()
        if modifiers
    ]
    script = _BASH.format(modifiers="\n".join(rows), options=" ".join(names))
    return script if shell == "bash" else f"autoload -U +X bashcompinit && bashcompinit\n{script}"


def declarations() -> Iterator[tuple[str, tuple[str, ...], str, tuple[Parameter, ...]]]:
    """Of each op and option: its name, what follows it, what it does, its modifiers."""
    for ops in LANGUAGE.ops.values():
        for op in ops:
            yield op.flag(), tuple(p.name.upper() for p in op.arguments()), summary(op), op.modifiers()
    for option in LANGUAGE.options:
        yield option.name, option.arguments, option.help, option.parameters()


def _fish() -> str:
    modifiers, options = [], []
    for flag, arguments, help, known in declarations():
        if known:
            names = " ".join(f'"$begun"{p.name}=' for p in known)
            modifiers.append(f"        case {flag}\n            printf '%s\\n' {names}")
        kind = "-l" if flag.startswith("--") else "-s" if len(flag) == 2 else "-o"
        takes = " -r -F" if "FILE" in arguments else " -x" if arguments else ""
        text = help.replace("\\", "\\\\").replace("'", "\\'")
        options.append(f"complete -c oiiotex {kind} {flag.lstrip('-')}{takes} -d '{text}'")
    return _FISH.format(modifiers="\n".join(modifiers), options="\n".join(options))


# --- man ---

_EXIT = (
    ("0", "All is done."),
    ("1", "Something is wrong, which one line on standard error says; or images differ."),
    ("130, 143", "Stopped by SIGINT, by SIGTERM."),
)
_ENVIRONMENT = (
    ("OCIO", "The color config, unless --colorconfig says one."),
    ("OIIOTEX_DEVICE", "The OpenCL device, unless --device says one."),
    ("TMPDIR", "Where intermediate results lie that do not fit the budget."),
    ("XDG_CACHE_HOME", "Where the cache folder lies: see --cache-info."),
)


def manual() -> str:
    """The program's page for `man`, in roff."""
    lines = [
        f'.TH OIIOTEX 1 "" "oiiotex {__version__}" "User Commands"',
        ".ad l",  # long words are no cause for gaps
        ".SH NAME",
        "oiiotex \\- texture filters in an oiiotool\\-style chain",
        ".SH SYNOPSIS",
        ".B oiiotex",
        _roff("[IMAGE | --OP[:MODIFIER=VALUE...] [ARGUMENT...]]... -o FILE"),
    ]
    for heading, ops in LANGUAGE.ops.items():
        lines += [f'.SH "{_roff(heading).upper()}"', *(line for op in ops for line in _op_lines(op))]
    for heading, options in LANGUAGE.groups.items():
        lines += [f'.SH "{_roff(heading).upper()}"', *(line for option in options for line in _option_lines(option))]
    for heading, facts in (("EXIT STATUS", _EXIT), ("ENVIRONMENT", _ENVIRONMENT)):
        lines += [f".SH {heading}", *(line for name, text in facts for line in _entry(name, text))]
    return "\n".join(lines)


def _op_lines(op: type[Op]) -> Iterator[str]:
    paragraphs = [" ".join(piece.split()) for piece in description(op).split("\n\n")]
    yield from _entry(call(op), paragraphs[0])
    for paragraph in paragraphs[1:]:
        yield from (".IP", _roff(paragraph))
    yield from _modifier_lines(op.modifiers())


def _option_lines(option: Option) -> Iterator[str]:
    yield from _entry(option.call, option.help)
    yield from _modifier_lines(option.parameters())


def _modifier_lines(modifiers: Iterable[Parameter]) -> Iterator[str]:
    yield ".RS"
    for parameter in modifiers:
        yield from _entry(f":{parameter.name}=", parameter.described(parameter.help))
    yield ".RE"


def _entry(name: str, text: str) -> tuple[str, ...]:
    return ".TP", f".B {_roff(name)}", _roff(text)


def _roff(text: str) -> str:
    """A text for roff: one line in which nothing is a command."""
    text = " ".join(text.split()).replace("\\", "\\e").replace("-", "\\-")
    return f"\\&{text}" if text[:1] in (".", "'") else text
