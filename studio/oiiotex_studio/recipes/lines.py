# SPDX-License-Identifier: Apache-2.0
"""Expands the placeholders of a recipe's lines into command lines for one material."""

from __future__ import annotations

import contextlib
import itertools
import os
import re
import shlex
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from oiiotex.engine.deferred import np
from oiiotex.engine.errors import Error, ParameterError, within

from ..api.files import OUTSIDE, OutsideError, writing_only_below
from ..api.images import from_array
from ..api.lines import LANGUAGE, nearest, parse, split_modifiers
from ..api.lines import Step as WrittenStep
from ..materials.naming import COLORS, ROLES
from .found import MapFile
from .recipe import Deliver, LibraryRecipe

LIBRARY_MEASURES = ("normal_length", "height_steps", "hex_fidelity", "labels", "tiles")  # measured without a report
SOURCE = "source"  # folder of a material's maps while lines run
_HOLE = re.compile(r"\$(?:(\$)|\{([a-z_0-9.]+)\}|([a-z_0-9]+(?:\.[a-z_0-9]+)?))")
_FLIP = ("--mulc", "1,-1,1", "--addc", "0,1,0")  # inverts y of normals in 0..1: DirectX to OpenGL
_SPREADS = "`oiiotex-library ingest` distributes materials itself"
_SHOWS = "a library is made without a display"
_ONCE = "a line runs once for each material"
_NOT_HERE = {
    "--frames": _ONCE, "--each": _ONCE, "--views": _ONCE, "--parallel-frames": _ONCE, "--farm": _SPREADS,
    "--share": _SPREADS, "--join": _SPREADS, "--openjd": _SPREADS, "--texlive": _SHOWS, "--tev": _SHOWS,
    "--oiioattrib": "it would affect the lines of other materials",
}  # fmt: skip
_EVERY_MAP = {role: MapFile(f"{role}.png", hand="opengl") for role in ROLES}
_KINDS = {"color": "color", "normal": "normal", "height": "height"}


class ProductStep(NamedTuple):
    """A product's line for one material.

    Attributes
    ----------
    product : str
    words : tuple of str
        Command line to run in the asset's folder.
    takes : tuple of str
        Products whose files the line reads.
    outputs : mapping of role to str
        Files written by `$outputs`, by role, below the asset's folder.
    """

    product: str
    words: tuple[str, ...]
    takes: tuple[str, ...] = ()
    outputs: Mapping[str, str] = {}


def steps_of(recipe: LibraryRecipe, maps: Mapping[str, MapFile]) -> list[ProductStep]:
    """The lines of a recipe for a material with these maps.

    Lines that require a missing map are skipped, as are lines that read files of a skipped product.

    Raises
    ------
    ParameterError
        A placeholder is invalid.
    """
    steps: list[ProductStep] = []
    names = [product.name for product in recipe.products]
    made: set[str] = set()
    for number, product in enumerate(recipe.products):
        filler = _Filler(product.name, recipe, maps, names[:number], made)
        words = list[str]()
        with within(f"product {product.name}"):
            if "\0" in product.line:
                raise ParameterError("a line cannot contain the character NUL")
            try:
                parts = shlex.split(product.line)
            except ValueError as error:
                raise ParameterError(f"{error}") from error
            for text in parts:
                words += filler.filled(text, words)
        if not filler.lacking:
            steps.append(ProductStep(product.name, tuple(words), tuple(sorted(filler.takes)), filler.outputs))
            made.add(product.name)
    return steps


def require_lines(recipe: LibraryRecipe) -> str:
    """Check the lines without a material, and return the name of the product with `$outputs`, which is delivered.

    Raises
    ------
    ParameterError
        An option, a modifier or a placeholder is unknown or not supported in a library, or not exactly one line has
        `$outputs`, once and after all images.
    """
    steps = steps_of(recipe, _EVERY_MAP)
    for step in steps:
        with within(f"product {step.product}"):
            _require_deliverable(step)
    delivered = [step for step in steps if step.outputs]
    if len(delivered) != 1:
        raise ParameterError(f"{len(delivered)} products have $outputs: expected exactly one, which is delivered")
    ops = [each for each in parse(list(delivered[0].words), LANGUAGE).steps if each.op]
    modifiers = [split_modifiers(each.word)[1] for each in ops]
    packed = any(own.get("pack") == "atlas" for own in modifiers)
    if recipe.deliver.wang and not packed:
        hint = "add :variants=16:size=512x512:pack=atlas to --texstationarize"
        raise ParameterError(f"product {delivered[0].product}: wang = true delivers atlases of Wang tiles; {hint}")
    sets = [own["variants"] for own in modifiers if own.get("variants", "1") != "1"]
    if sets and not packed:
        problem = f"product {delivered[0].product}: variants={sets[-1]} makes several images of each map"
        raise ParameterError(problem, hint="add pack=atlas, which delivers them as one, or remove variants")
    _require_measured(recipe, delivered[0].product)
    return delivered[0].product


def _require_measured(recipe: LibraryRecipe, name: str) -> None:
    """Raise ParameterError for limits of measures that do not exist, or that no report of the delivered product has."""
    from ..api.measures import REPORT_MEASURES

    line = next(product.line for product in recipe.products if product.name == name)
    for measure in (limit.measure for limit in recipe.limits if limit.measure not in LIBRARY_MEASURES):
        if measure not in REPORT_MEASURES:
            known = (*LIBRARY_MEASURES, *REPORT_MEASURES)
            problem = f"judge: limits: unknown measure '{measure}'{nearest(measure, known)}"
            raise ParameterError(problem, hint=f"expected one of {', '.join(known)}")
        if "report" not in itertools.chain(*_HOLE.findall(line)):
            problem = f"judge: limits: product {name} does not report '{measure}'"
            raise ParameterError(problem, hint="add :report=$report to the op of its line, or remove the limit")


def require_confined(recipe: LibraryRecipe) -> None:
    """Raise ParameterError for output files outside a product's folder, as far as known without pixels.

    Lines are rehearsed in a folder like an asset's, with expressions and control flow. If a file name depends on
    pixels, the error occurs during the run.

    Raises
    ------
    ParameterError
        A line writes such a file.
    """
    import tempfile

    from ..api.lines import Frame, Rehearsals, as_provisional, session_for

    some = as_provisional(from_array(np.zeros((1, 1, 3), np.float16)))
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        files = {os.path.realpath(source_name(role, file)): some for role, file in _EVERY_MAP.items()}
        for step in steps_of(recipe, _EVERY_MAP):
            os.mkdir(step.product)
            words = list(step.words)
            command = parse(words, LANGUAGE)
            rehearsals = Rehearsals(session_for(command, words), files)
            try:
                with within(f"product {step.product}"), writing_only_below(Path(step.product)):
                    rehearsals.foresight(command.steps, Frame(None, step.words))
            except OutsideError:
                raise
            except Error:  # other errors can be specific to a material
                pass


def _require_deliverable(step: ProductStep) -> None:
    """Raise ParameterError for interactive or farm options, for files outside, and for images after `$outputs`."""
    command = parse(list(step.words), LANGUAGE)
    named = {*command.settings, *(each.option.name for each in command.steps if each.option)}
    for name in sorted(named & _NOT_HERE.keys()):
        raise ParameterError(f"{name} cannot be used in a recipe: {_NOT_HERE[name]}; remove it")
    for each in command.steps:
        for said, name in _written(each):
            parts = name.split("/")
            # expressions are checked by the rehearsal or the run
            if not (parts[0] == step.product or parts[0].startswith("{")) or ".." in parts:
                raise ParameterError(f"{said}: {OUTSIDE}")
    places = [place for place, word in enumerate(step.words) if word in step.outputs.values()]
    if len(places) > len(step.outputs):
        raise ParameterError("$outputs occurs twice, or another -o writes the same file")
    if places:
        before = parse(list(step.words[: places[-1] + 1]), LANGUAGE).steps
        for each in command.steps[len(before) :]:
            if not each.op and not each.option:
                raise ParameterError(f"'{each.word}' after $outputs: expected only options there")


def _written(step: WrittenStep) -> Iterator[tuple[str, str]]:
    """Files that a step of a line writes: (text in the line, file name)."""
    if step.option and step.option.writes:
        yield f"{step.word} {step.arguments[-1]}", step.arguments[-1]
    if step.op:
        asking = {output.asked_by for output in step.op.outputs}
        for key, value in split_modifiers(step.word)[1].items():
            if key in asking and value not in ("0", "1"):  # 0 and 1 request a part of the result, not a file
                yield f"{step.name}:{key}={value}", value


@dataclass
class _Filler:
    """Expands the words of one product's line."""

    product: str
    recipe: LibraryRecipe
    maps: Mapping[str, MapFile]
    before: Sequence[str]
    made: set[str]

    def __post_init__(self) -> None:
        self.lacking = False
        self.takes: set[str] = set()
        self.outputs: dict[str, str] = {}
        self._whole: dict[str, Callable[[], list[str]]] = {
            "maps": lambda: [word for role in self.maps for word in self._read(role)],
            "outputs": self._write,
        }

    def filled(self, text: str, before: Sequence[str]) -> list[str]:
        """Expand a word of the line into words that follow those in `before`."""
        match = _HOLE.fullmatch(text)
        name = match[2] or match[3] if match else None
        if name not in self._whole and name not in ROLES:
            return [_HOLE.sub(self._text, text)]
        if waiting := _waiting(before):
            raise ParameterError(f"{waiting} would take the first word of {text}; remove it, or add its argument")
        return self._whole[name]() if name in self._whole else self._read(name)

    def _text(self, match: re.Match[str]) -> str:
        if match[1]:
            return "$"
        name = match[2] or match[3]
        own = {
            "kinds": ",".join(_KINDS.get(role, "data") for role in self.maps),
            "folder": self.product,
            "output": f"{self.product}/{self.product}.exr",
            "report": f"{self.product}/report.json",
        }
        if name in own:
            return own[name]
        product, dot, file = name.partition(".")
        if dot and product in self.before:
            self.lacking |= product not in self.made
            self.takes.add(product)
            tile = file in ROLES and f"{product}/{file}{_suffix(self.recipe.deliver)}"
            return tile or f"{product}/{file}.exr"
        if name in ROLES or name in self._whole:
            raise ParameterError(f"${name} must be a separate word, not part of '{match.string}'")
        raise ParameterError(f"unknown placeholder ${name}; see `oiiotex-library recipe` ($$ is a dollar sign)")

    def _read(self, role: str) -> list[str]:
        """The words that read a map."""
        file = self.maps.get(role)
        if file is None:
            self.lacking = True
            return []
        space = self.recipe.space(role, file.floats)
        words = [source_name(role, file)]
        if space:
            words += ["--iscolorspace", space]
        if file.channel:
            words += ["--ch", file.channel]
        if file.hand == "directx" and self.recipe.deliver.normals == "opengl":
            words += _FLIP
        return words

    def _write(self) -> list[str]:
        """The words that write all maps, from the top of the stack down."""
        deliver, words = self.recipe.deliver, list[str]()
        for role in self.maps:
            path = f"{self.product}/{role}{_suffix(deliver)}"
            self.outputs[role] = path
            kind = "uint16" if deliver.format == "tiff" else "float" if role == "height" else "half"
            convert = ["--tocolorspace", deliver.color] if role in COLORS and deliver.color else []
            words = [*convert, "-d", kind, "-o", path, *(["--pop", *words] if words else [])]
        return words


def _waiting(words: Sequence[str]) -> str:
    """The option at the end of a line that lacks arguments; '' if there is none."""
    word, place = "", 0
    while place < len(words):
        word = words[place]
        place += 1 + (LANGUAGE.takes(word) if word.startswith("-") and word != "-" else 0)
    return word if place > len(words) else ""


def source_name(role: str, file: MapFile) -> str:
    """Path of a material's map while its lines run."""
    return f"{SOURCE}/{role}{file.suffix}"


def _suffix(deliver: Deliver) -> str:
    return ".tif" if deliver.format == "tiff" else ".exr"
