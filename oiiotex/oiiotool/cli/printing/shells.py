# SPDX-License-Identifier: Apache-2.0
"""Completion scripts for shells, generated from the declarations."""

from __future__ import annotations

from ....engine.errors import ParameterError
from .help import words
from .report import declarations

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
