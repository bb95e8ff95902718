# SPDX-License-Identifier: Apache-2.0
"""Completion scripts for shells and the page for `man`, generated from the declarations."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from .... import __version__
from ....engine.core.op import Op
from ....engine.core.parameters import Parameter
from ....engine.errors import ParameterError
from ..language.parse import Option
from ..vocabulary import LANGUAGE
from .help import words
from .report import call, declarations, description

_BASH = """\
_oiiotex_modifiers() {{
  case "$1" in
{modifiers}
  esac
}}
_oiiotex() {{
  local line="${{COMP_LINE:0:COMP_POINT}}" op
  local word="${{line##* }}"
  COMPREPLY=()
  case "$line" in
    *" --help :"* | *" -h :"*) COMPREPLY=($(compgen -W "{every}" -- "${{word##*:}}")); return ;;
    *" --help "*:* | *" -h "*:*)
      op="${{word%%:*}}" op="${{op##*-}}"
      op="$(_oiiotex_modifiers "--tex$op" || _oiiotex_modifiers "${{word%%:*}}" || _oiiotex_modifiers "--$op")"
      COMPREPLY=($(compgen -W "$op" -- "${{word##*:}}")); return ;;
    *" --help "[!-]* | *" -h "[!-]* | *" --help " | *" -h ")
      COMPREPLY=($(compgen -W "{topics}" -- "$word")); return ;;
  esac
  case "$word" in
    -*:*)
      compopt -o nospace 2>/dev/null
      COMPREPLY=($(compgen -S = -W "$(_oiiotex_modifiers "${{word%%:*}}")" -- "${{word##*:}}")) ;;
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
{options}
complete -c oiiotex -n '__fish_prev_arg_in --help -h' -x -a '{topics}'"""


def completion(shell: str) -> str:
    """A script for the shell that completes options, modifiers, topics of --help and files."""
    if shell not in ("bash", "zsh", "fish"):
        raise ParameterError(f"--completion {shell}: expected bash, zsh or fish")
    modifiers = {flag: [p.name for p in known] for flag, _, _, known in declarations()}
    every = sorted({name for names in modifiers.values() for name in names})
    topics = " ".join(dict.fromkeys((*words(), *(flag.lstrip("-") for flag in modifiers))))
    if shell == "fish":
        return _fish(" ".join((topics, *(f":{name}" for name in every))))
    rows = [f"    {flag}) echo {' '.join(names)} ;;" for flag, names in modifiers.items() if names]
    rows.append("    *) return 1 ;;")
    script = _BASH.format(modifiers="\n".join(rows), every=" ".join(every), topics=topics, options=" ".join(modifiers))
    return script if shell == "bash" else f"autoload -U +X bashcompinit && bashcompinit\n{script}"


def _fish(topics: str) -> str:
    modifiers, options = [], []
    for flag, arguments, help, known in declarations():
        if known:
            names = " ".join(f'"$begun"{p.name}=' for p in known)
            modifiers.append(f"        case {flag}\n            printf '%s\\n' {names}")
        kind = "-l" if flag.startswith("--") else "-s" if len(flag) == 2 else "-o"
        takes = " -r -F" if "FILE" in arguments else " -x" if arguments else ""
        text = help.replace("\\", "\\\\").replace("'", "\\'")
        options.append(f"complete -c oiiotex {kind} {flag.lstrip('-')}{takes} -d '{text}'")
    return _FISH.format(modifiers="\n".join(modifiers), options="\n".join(options), topics=topics)


_EXIT = (
    ("0", "Success."),
    ("1", "An error, reported in one line on standard error; or compared images differ."),
    ("3", "All files are written, and a measure exceeds a limit of the modifier fail."),
    ("129, 130, 143", "Stopped by SIGHUP, SIGINT or SIGTERM."),
)
_ENVIRONMENT = (
    ("OCIO", "The color config, unless --colorconfig is given."),
    ("OIIOTEX_DEVICE", "The OpenCL device, unless --device is given."),
    ("TMPDIR", "Folder for intermediate results that exceed the memory budget."),
    ("XDG_CACHE_HOME", "Folder that contains the cache folder: see --cache-info."),
)


def manual() -> str:
    """The program's page for `man`, in roff."""
    lines = [
        f'.TH OIIOTEX 1 "" "oiiotex {__version__}" "User Commands"',
        ".ad l",  # no gaps before long words
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
    """A text for roff as one line, with its special characters escaped."""
    text = " ".join(text.split()).replace("\\", "\\e").replace("-", "\\-")
    return f"\\&{text}" if text[:1] in (".", "'") else text
