# SPDX-License-Identifier: Apache-2.0
"""--help and its topics: one screen, groups, ops, modifiers; unknown words are searched for."""

from __future__ import annotations

import re
import textwrap
from importlib import resources
from pathlib import Path

from ... import __version__
from ...errors import ParameterError
from ..vocabulary import LANGUAGE
from .report import columns, declarations, described, find, overview, page

_SCREEN = """\
oiiotex {version}: textures from photos, on command lines as oiiotool has them
usage: oiiotex IMAGE... --OP[:MODIFIER=VALUE...]... -o FILE

  oiiotex photo.png --texstationarize -o tile.png          seamless tile
  oiiotex tile.png --texpreview:panels=3x3 -o view.png     the tile repeated
  oiiotex photo.png --texquilt:size=4096x4096 -o big.png   larger texture
  oiiotex photo.png --texsynth:size=4096x4096 -o all.png   unbounded texture
  oiiotex color.png normal.png --texstationarize:kinds=color,normal \\
      -o normal_tile.png --pop -o color_tile.png           maps of a material
  oiiotex photo.png --texestimateheight -o height.exr      height from shading
  oiiotex photo.png --texlabel:keep=1 -o labels.exr        its textures, labeled
  oiiotex photo.png --texflatten -o flat.png               no gradients, stains
  oiiotex photo.png --resize 50% --texflatten -o f.png     with oiiotool's ops
  oiiotex photo.png --texlive                              all in a browser

  --help texture          all texture filters  --help :size   ops that have it
  --help texstationarize  one op               --help stains  find a word
  --help texstationarize:preset  one modifier  --help all     ops and options
{groups}
First steps: docs/start/first-tile.md
Compared with oiiotool: docs/reference/differences.md"""
_MOST_HITS = 5  # of a search, of ops and of pages
_INDEX = "docs/how-to/index.md"


def topic(name: str = "") -> str:
    """The text of --help with a word after it: '', 'all', a group, an op, OP:MODIFIER or :MODIFIER.

    Another word is searched for. Raises a ParameterError, which names the nearest known word, if it occurs nowhere.
    """
    if not name:
        groups = " ".join(("Groups for --help:", *words()))
        return _SCREEN.format(version=__version__, groups=textwrap.fill(groups, 80, subsequent_indent="  "))
    if name in words():
        return overview(name)
    if name.startswith(":"):
        return _with_modifier(name[1:].rstrip("="))
    try:
        find(name.partition(":")[0])
    except ParameterError:
        return _search(name)
    return page(name.rstrip("="))


def words() -> tuple[str, ...]:
    """The groups of --help."""
    return tuple(dict.fromkeys((*LANGUAGE.words.values(), "all")))


def _with_modifier(name: str) -> str:
    """The help of a modifier, and the ops and options that have it."""
    flags: dict[str, list[str]] = {}
    for flag, _, _, modifiers in declarations():
        for one in modifiers:
            if one.name == name:
                flags.setdefault(described(one, find(flag)), []).append(flag)
    if not flags:
        return _search(f":{name}")
    fill = textwrap.TextWrapper(columns(), break_on_hyphens=False)
    indented = textwrap.TextWrapper(columns(), initial_indent="    ", subsequent_indent="    ")
    entries = (f"{fill.fill(', '.join(found))}:\n{indented.fill(text)}" for text, found in flags.items())
    return "\n\n".join((f":{name}=", *entries))


def _search(name: str) -> str:
    """Where a word occurs that names nothing. Raises a ParameterError if it is near a known one, or occurs nowhere."""
    import difflib  # slow to import

    bare = name.lstrip("-:").partition(":")[0].lower()
    known: dict[str, str] = {word: word for word in words()}
    summaries = {flag: (text, modifiers) for flag, _, text, modifiers in declarations()}
    for flag in summaries:
        known |= {flag.lstrip("-").lower(): flag, flag.removeprefix("--tex").lstrip("-").lower(): flag}
    for _, modifiers in summaries.values():
        known = {one.name.lower(): f":{one.name}" for one in modifiers} | known
    word = re.compile(rf"\b{re.escape(bare.removesuffix('s'))}", re.IGNORECASE)
    hits = [flag for flag, (text, _) in summaries.items() if bare and word.search(f"{flag} {text}")][:_MOST_HITS]
    rows = [row for row in _how_to().splitlines() if bare and word.search(row)]
    pages = [f"docs/how-to/{file}" for row in rows for file in re.findall(r"\(([\w-]+\.md)\)", row)][:_MOST_HITS]
    if bare not in known and (pages or hits):
        return "\n".join((f"'{name}' occurs in:", *(f"  {place}" for place in (*pages, *hits))))
    close = difflib.get_close_matches(bare, known, 1, 0.8)
    hint = f"did you mean --help {known[close[0]]}?" if close else "oiiotex --help all lists everything"
    raise ParameterError(f"--help {name}: expected a group, an op, OP:MODIFIER or :MODIFIER", hint=hint)


def _how_to() -> str:
    """The index of the how-to pages: of the checkout, else of the installed package."""
    try:
        path = Path(__file__).parents[3] / _INDEX
        return (path if path.exists() else resources.files("oiiotex.howto") / path.name).read_text()
    except (ModuleNotFoundError, FileNotFoundError):
        return ""
