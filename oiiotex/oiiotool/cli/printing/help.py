# SPDX-License-Identifier: Apache-2.0
"""--help and its topics: one screen, groups, ops, modifiers; unknown words are searched for."""

from __future__ import annotations

import itertools
import re
import textwrap

from .... import __version__
from ....engine.errors import ParameterError
from ....engine.shipped import shipped
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
  oiiotex photo.png --texlabel:photo=1 -o labels.exr       its textures, labeled
  oiiotex photo.png --texflatten -o flat.png               no gradients, stains
  oiiotex photo.png --resize 50% --texflatten -o f.png     with oiiotool's ops
  oiiotex photo.png --texlive                              all in a browser

  --help texture          all texture filters  --help :size   ops that have it
  --help texstationarize  one op               --help stains  find a word
  --help texstationarize:preset  one modifier  --help all     ops and options
{groups}
First steps: docs/start/first-tile.md
Compared with oiiotool: docs/reference/differences.md"""
_MOST_HITS = 5  # of a search: pages, ops, modifiers


def topic(name: str = "") -> str:
    """The text of --help with a word after it: '', 'all', a group, an op, OP:MODIFIER or :MODIFIER.

    Another word is searched for. Raises a ParameterError, which names the nearest known word, if it occurs nowhere.
    """
    if not name:
        groups = " ".join(("Groups for --help:", *words()))
        return _SCREEN.format(version=__version__, groups=textwrap.fill(groups, 80, subsequent_indent="  "))
    if name in words():
        return overview(name) + _see_also(name)
    if name.startswith(":"):
        return _with_modifier(name[1:].rstrip("="))
    try:
        find(name.partition(":")[0])
    except ParameterError:
        return _search(name)
    return page(name.rstrip("=")) + _see_also(name)


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
    """Where a word occurs that names nothing. Raises a ParameterError, with the nearest known word, if nowhere."""
    import difflib  # slow to import

    places = _places(name)
    if places:
        return _listed(f"'{name}' occurs in:", places)
    known: dict[str, str] = {word: word for word in words()}
    for flag, _, _, modifiers in declarations():
        known |= {flag.lstrip("-").lower(): flag, flag.removeprefix("--tex").lstrip("-").lower(): flag}
        known = {one.name.lower(): f":{one.name}" for one in modifiers} | known
    close = difflib.get_close_matches(name.lstrip("-:").partition(":")[0].lower(), known, 1, 0.8)
    hint = f"did you mean --help {known[close[0]]}?" if close else "oiiotex --help all lists everything"
    raise ParameterError(f"--help {name}: expected a group, an op, OP:MODIFIER or :MODIFIER", hint=hint)


def _see_also(name: str) -> str:
    """The how-to pages that mention a word, under a heading; '' if there are none."""
    pages = _pages(name)
    return f"\n\n{_listed('See also:', pages)}" if pages else ""


def _mention(name: str) -> re.Pattern[str]:
    """Finds a word and its plural; nothing for names that begin with - or :."""
    bare = "" if name.startswith(("-", ":")) else name.partition(":")[0].lower()
    stem = bare if bare.endswith("ss") else bare.removesuffix("s")
    return re.compile(rf"\b{re.escape(stem)}(s|es|ed|ing)?\b" if stem else "(?!)", re.IGNORECASE)


def _pages(name: str) -> dict[str, str]:
    """The how-to pages whose problem or title mentions a word, each with its problem."""
    rows = filter(_mention(name).search, _how_to().splitlines())
    found = ((file, row) for row in rows for file in re.findall(r"\(([\w-]+\.md)\)", row))
    return {f"docs/how-to/{file}": row.split("|")[1].strip() for file, row in itertools.islice(found, _MOST_HITS)}


def _places(name: str) -> dict[str, str]:
    """The how-to pages, ops and modifiers that mention a word, each with its description."""
    word = _mention(name)
    ops: dict[str, str] = {}
    named: dict[str, str] = {}  # modifiers of that name
    modifiers: dict[str, str] = {}  # by their help
    for flag, _, text, parameters in declarations():
        if word.search(f"{flag} {text}"):
            ops[flag] = text
        for one in parameters:
            if one.name == name.lower():
                named[f":{one.name}"] = one.help
            elif flag.startswith("--tex") and word.search(one.help):
                modifiers.setdefault(one.help, f"{flag}:{one.name}")
    places = [_pages(name)]
    for found in (ops, named, {place: text for text, place in modifiers.items()}):
        places.append({at: text.partition(". ")[0].rstrip(".") for at, text in [*found.items()][:_MOST_HITS]})
    return {place: text for found in places for place, text in found.items()}


def _listed(heading: str, places: dict[str, str]) -> str:
    """Places and their descriptions, under a heading."""
    width = max(map(len, places))
    indented = textwrap.TextWrapper(columns(), subsequent_indent=" " * (width + 4), break_on_hyphens=False)
    return "\n".join((heading, *(indented.fill(f"  {place:{width}}  {text}") for place, text in places.items())))


def _how_to() -> str:
    """The index of the how-to pages: of the checkout, else of the installed package."""
    try:
        return (shipped("howto", "docs/how-to") / "index.md").read_text()
    except FileNotFoundError:
        return ""
