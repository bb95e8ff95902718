# SPDX-License-Identifier: Apache-2.0
"""Phrases that nobody outside of this project would write, and where they stand: `python -m tests.plain_words PATH...`.

The words to use instead stand next to each phrase.
"""

from __future__ import annotations

import ast
import io
import re
import sys
import tokenize
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[1]
PLACES = ("oiiotex", "studio", "hosts", "tools", "benchmarks", "docs", "README.md", "CONTRIBUTING.md", "CHANGELOG.md")
# pattern, what to write instead
BANNED = {
    r"left out": "default ...; omitted",
    r"allowed (is|are|behind)|(?<!not )\b(is|are) allowed": "expected ...; must be ...",
    r"(is|are|what is|one) wanted\b": "expected; required",
    r"whole numbers?|broken numbers?": "integer; float",
    r"\banew\b": "re-",
    r"\bbesides?\b": "alongside; next to; compared with; in addition to",
    r"\bbehind\b": "after",
    r"hang(s|ing)? (on|together)|hung on": "depends on; belong together",
    r"\bgo(es|ing)? with\b": "requires; belongs to",
    r"with commas": "comma-separated",
    r"\bso many\b": "number of ...",
    r"\bletters? (at most|or more)|[0-9] letters": "characters",
    r"at a slant": "oblique; perspective",
    r"\b(is|are|was|be) said\b|says? it already|\bsay [a-z_]+=|, too\b(?=[.:;]|$)": "reported; set ...; also",
    r"out of nothing": "generators",
    r"without end": "unbounded",
    r"seen least": "minimum-error seam",
    r"slow drift|drifts? slowly": "low-frequency variation",
    r"prices? of use|offset prices?": "reuse penalty; offset penalty",
    r"looked? through|looks at one pixel|looks around": "out-of-core; pointwise; neighborhood",
    r"(pass|passes) in bands": "two-pass, out-of-core",
    r"undone of": "unpremultiplied",
    r"even sky": "ambient occlusion",
    r"(to|for) people\b": "visualize",
    r"bits made of more": "quantize to 8 bits",
    r"forget the": "pop; discard",
    r"how alike": "similarity",
    r"made things?": "asset; catalog entry",
    r"(?<![Tt]here )\b(is|are|were|was) no (?!longer|more|less|need|way|one)": "is not a ...",
    r"to the bit\b": "bit for bit; bit-identical",
    r"by the clock": "wall-clock",
    r"of (its|their) own\b": "separate; own ...",
    r"\bshall\b": "must; should",
    r"\b(thereof|therein|whereof|thereby|hence|aught|nought)\b": "(plain sentence)",
    r"\bmay not\b": "must not; cannot",
    r"\bmend(s|ed|ing)?\b": "fix",
    r"texts\b": "strings",
    r"\bheeds?\b": "uses; respects",
    r"(^|[.;:] )What [^.?!]*,": "subject, verb, object",
    r"goes on\b(?! to)|\bgo on\b": "resumes; continues",
    r"so that nothing|that is how": "(plain sentence)",
}
_PATTERN = re.compile("|".join(f"(?:{phrase})" for phrase in BANNED), re.IGNORECASE | re.MULTILINE)
_QUOTED = re.compile(r"\"[^\"\n]*\"")
_FENCES = re.compile(r"^```.*?^```|`[^`\n]*`", re.MULTILINE | re.DOTALL)


def prose(path: Path) -> Iterator[tuple[int, str]]:
    """(line number, text) of everything in a file that people read: strings, docstrings, comments, or all of it."""
    text = path.read_text()
    if path.suffix in (".py", ".pyi"):
        for token in tokenize.generate_tokens(io.StringIO(text).readline):
            if token.type == tokenize.COMMENT:
                yield token.start[0], token.string
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.Constant) and isinstance(node.value, str) and " " in node.value.strip():
                yield node.lineno, node.value
    elif path.suffix == ".md":
        yield 1, _FENCES.sub(lambda code: "\n" * code.group().count("\n") or "CODE", text)
    else:
        yield 1, text


def found(path: Path) -> Iterator[str]:
    """'file:line: phrase: write ...' for each banned phrase in a file."""
    for line, text in prose(path):
        for match in _PATTERN.finditer(_QUOTED.sub("", text) if path.suffix == ".md" else text):
            instead = next(word for phrase, word in BANNED.items() if re.fullmatch(phrase, match.group(), re.I | re.M))
            at = line + text[: match.start()].count("\n")
            yield f"{path}:{at}: '{' '.join(match.group().split())}': write {instead}"


def files(places: tuple[str | Path, ...] = PLACES) -> Iterator[Path]:
    """The files of text below some places."""
    for place in map(ROOT.joinpath, places):
        for path in [place] if place.is_file() else sorted(place.rglob("*")):
            if path.suffix in (".py", ".pyi", ".md", ".cl", ".js", ".html", ".css") and "__pycache__" not in path.parts:
                yield path


if __name__ == "__main__":
    lines = [line for path in files(tuple(sys.argv[1:]) or PLACES) for line in found(path)]
    print(*lines, f"{len(lines)} phrases", sep="\n")
