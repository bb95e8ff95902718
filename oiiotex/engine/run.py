# SPDX-License-Identifier: Apache-2.0
"""One run of an op, from its checked values to parts, files and printed lines.

This module defines the meaning of each kind of output for all ops: pixel type, color tag, whether values may be
converted, and whether it becomes a part of the image, a separate file, or text. Files are checked before the work.
"""

from __future__ import annotations

import contextlib
import itertools
import json
import logging
import os
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from .. import __version__
from .core.access import Neighborhood, Pointwise
from .core.attributes import PROVISIONAL, SOURCE, mark_as_data, note, tag_colors
from .core.demand import sha1
from .core.image import Image, Part, from_pixels
from .core.label_map import LabelMap
from .core.op import Kind, Op, Output, Plan, Space, errors_of, no_pixels
from .core.source_map import Copied, Sources
from .deferred import np, oiio
from .errors import Error, ImageError, ParameterError, present
from .io.atomic import require_place, temporary_beside
from .io.cryptomatte import cryptomatte_part
from .io.paint_palette import require_palette, write_palette
from .io.writing import require_writable, write
from .operands import check_operands

if TYPE_CHECKING:
    from .session import Session
    from .session.facts import Facts

log = logging.getLogger("oiiotex")

_TYPES = {Kind.IDS: "uint", Kind.PICTURE: "uint8"} | dict.fromkeys(
    (Kind.MASK, Kind.COORDINATES, Kind.MEASURE, Kind.CRYPTOMATTE), "float"
)
_CHANNELS = {Kind.COORDINATES: 2, Kind.PICTURE: 3, Kind.CRYPTOMATTE: 4} | dict.fromkeys(
    (Kind.IDS, Kind.MASK, Kind.MEASURE), 1
)
_LARGE = 1 << 20  # bytes; a larger manifest should be a separate file


class Result(NamedTuple):
    """An image made by an op, the names of its parts in Python, and the limits that it exceeds, as text."""

    image: Image
    names: tuple[str, ...]
    failed: tuple[str, ...] = ()


def run(op: Op, session: Session, written: set[str] | None = None, provenance: bool = True) -> tuple[Result, ...]:
    """Run an op: returns its images, and writes the requested files and lines.

    Parameters
    ----------
    op : Op
    written : set of str, optional
        Real paths of files written by earlier ops of the same line; new ones are added.
    provenance : bool
        Whether files get metadata about their origin; images always do.

    Raises
    ------
    ParameterError
        A file would overwrite an input of the op, another of its files, or one in `written`.
    ImageError
        A folder is not writable, or a format cannot store an output; also errors of the op.
    """
    written = set() if written is None else written
    files = op.files()
    with errors_of(type(op)):
        _require_free(op, files, written)
        check_operands(op, session.resources)
        session.resources.require_streamable(*op.scanned())
        facts = _facts(op)
        # first, so that its errors precede reading the photo for its hash
        results = op.make(op.plan(session.resources), session)
        sources = [(name, facts | _photo(op, name, part) if facts else {}) for name, part in _sources(op)]
        session.resources.forget_scanned(*op.scanned())
        made = _Runner(op, session, files, provenance).results(results, sources)
        op.say_what_stays({part.name for result in made for part in result.image.parts})
    written.update(os.path.realpath(path) for path in files.values())
    return made


def planned(op: Op, facts: Facts, written: set[str]) -> tuple[Image, ...]:
    """The images that `run` will return, without pixels, as far as they are planned; nothing is done.

    Images are `is_provisional` if only the declaration of the op is known of them.

    Raises
    ------
    Error
        As in `run`, unless it may be due to a provisional image.
    """
    files, plan = op.files(), Plan()
    provisional = any(map(is_provisional, op.operands()))
    with errors_of(type(op)):
        _require_free(op, files, written)
        check_operands(op, facts)
        facts.require_streamable(*op.scanned())
        reads_written = any(os.path.realpath(path) in written for path in op.paths_read())
        written.update(os.path.realpath(path) for path in files.values())
        if not reads_written:  # otherwise its input is not written yet
            try:
                plan = op.plan(facts)
            except Error:
                if not provisional:
                    raise
    if plan.results is None:
        cycle = itertools.cycle(_sources(op))
        images = tuple(_declared(op, name) for name, _ in itertools.islice(cycle, op.result_count()))
        return tuple(map(as_provisional, images))
    sources = [(name, _facts(op)) for name, _ in _sources(op)]
    runner = _Runner(op, None, files, provenance=False)
    images = tuple(result.image for result in runner.results(plan.results, sources))
    return tuple(map(as_provisional, images)) if provisional else images


def is_provisional(image: Image) -> bool:
    """Whether windows, channels or number of the image's parts depend on pixels, so that they may change."""
    return any(part.spec.get_int_attribute(PROVISIONAL) for part in image.parts)


def as_provisional(image: Image) -> Image:
    """The image marked as one whose windows, channels or number of parts may change."""
    return Image(tuple(_saying(part, {PROVISIONAL: 1}) for part in image.parts), image.source)


def _declared(op: Op, source: str) -> Image:
    """An image with the parts and types that the op declares."""
    operands = op.operands()
    like = operands[0].first.spec if operands else oiio.ImageSpec(1, 1, 3, oiio.FLOAT)
    parts: list[Part] = []
    instead = tuple(output for output in op.outputs if output.instead and op.asked(output))
    for output in instead or op.outputs:
        asked = op.asked(output)
        if output.of:
            parts += [getattr(op, output.of).first] if asked else []
        elif asked is True and output.kind.is_image:
            name = operands[0].first.name if operands and output.kind is Kind.PIXELS else output.name
            copies = op.copies and output.kind is Kind.PIXELS
            parts.append(_declared_part(output, name, like, stored=op.prefix == Op.prefix, copies=copies))
    parts += op.carried()
    return Image(tuple(parts), source)


def _declared_part(output: Output, name: str, like: oiio.ImageSpec, stored: bool, copies: bool) -> Part:
    """A part of which only the kind of output is known."""
    count = _CHANNELS.get(output.kind, like.nchannels)
    spec = oiio.ImageSpec(1, 1, count, _type_of(output) or like.format)
    if output.kind is Kind.PIXELS:
        spec.channelnames, spec.alpha_channel = like.channelnames, like.alpha_channel

    pixel_type = spec.format if stored else None
    fetch = Copied(Sources(no_pixels, spec), no_pixels, (1, 1)) if copies else no_pixels
    return Part(name.replace(".N", ".1"), spec, fetch, pixel_type, ready=True, exact=output.kind.is_exact)


@dataclass(frozen=True)
class _Runner:
    """Turns the results of an op into images and files."""

    op: Op
    session: Session | None  # None: nothing is written or printed
    files: Mapping[str, Path]
    provenance: bool

    def results(self, results: Any, sources: Iterable[tuple[str, dict[str, Any]]]) -> tuple[Result, ...]:
        """The results of `Op.make` as images, with facts about their sources as metadata."""
        images = results if isinstance(results, tuple) else (results,)
        pairs = zip(images, itertools.cycle(sources), strict=False)
        return tuple(self.result(image, *source) for image, source in pairs)

    def result(self, results: Image | Mapping[str, Any], source: str, facts: dict[str, Any]) -> Result:
        """The image of one source, with facts as metadata; writes its files."""
        op = self.op
        if isinstance(results, Image):
            parts = [_saying(part, facts) for part in results.parts]
            return Result(Image(tuple(parts), results.source), _names(parts, op.main().name))
        first = next(iter(results))
        originals = [getattr(op, output.of).first for output in op.outputs if output.of and op.asked(output)]
        parts, tables = list(originals), []
        beside: dict[Path, list[Part]] = defaultdict(list)
        for name, output, path, value in self._wanted(results):
            if not output.kind.is_image:
                tables.append((output, path, value))
                continue
            part = self._part(output, name, path, value, name == first)
            (parts if path is None or output.kind is Kind.CRYPTOMATTE else beside[path]).append(part)
        for path, members in beside.items():
            with present(self.session).resources.checkpoints(path):
                metadata = facts if self.provenance else {}
                image = Image(tuple(_saying(part, metadata) for part in members), str(path))
                write(image, path, _type_of(op.output(members[0].name)))
        for table in tables:  # the files that they name exist now
            self._table_leaves(*table)
        failed = [text for output, _, report in tables if op.judges(output) for text in report["failed"]]
        parts = [_saying(part, facts) for part in (*parts, *op.carried())]
        return Result(Image(tuple(parts), source), _names(parts, "" if originals else first), tuple(failed))

    def _wanted(self, results: Mapping[str, Any]) -> Iterator[tuple[str, Output, Path | None, Any]]:
        """Name, declaration, file and value of each requested output, computed now if it is deferred."""
        for name, value in results.items():
            output = self.op.output(name)
            if self.session is None and not (self.op.asked(output) is True and output.kind.is_image):
                continue
            if self.op.asked(output) or self._is_said(output) or self.op.judges(output):
                path = self.files.get(name) or self.files.get(output.name)
                yield name, output, path, value() if callable(value) else value

    def _is_said(self, output: Output) -> bool:
        """Whether its lines are printed."""
        return output.lines is not None and present(self.session).progress.say is not None

    def _table_leaves(self, output: Output, path: Path | None, value: Any) -> None:
        """Print the lines of a table; write its file."""
        say = present(self.session).progress.say
        if output.lines is not None and say is not None:
            for line in output.lines(value):
                say(line)
        if path is None:
            return
        if output.kind is Kind.TABLE:
            _write_json(value, path)
            return
        if output.kind is Kind.PAINTS:
            write_palette(path, value)
            return
        with temporary_beside(path) as temporary, open(temporary, "wb") as file:
            file.write(value.encode()) if output.kind is Kind.MESH else np.savez_compressed(file, **value)

    def _part(self, output: Output, name: str, path: Path | None, value: Any, is_image: bool) -> Part:
        """A part of the type of its kind; tagged as data with the parameter data."""
        op = self.op
        if output.kind is Kind.PICTURE:
            return _picture(name, value)
        if output.kind is Kind.CRYPTOMATTE:
            return self._cryptomatte(value, path)
        pixel_type = _type_of(output)
        said_data = op.space is Space.LAB and op.working_space is Space.DATA  # set by the parameter data
        called = value.name if is_image else name  # the op's image may keep the photo's name

        def describe(spec: oiio.ImageSpec) -> None:
            if pixel_type is not None:
                spec.set_format(pixel_type)
                spec.channelformats = ()
            if pixel_type is not None or said_data:
                mark_as_data(spec)
            if called == name:
                spec.attribute("oiio:subimagename", name)

        part: Part = replace(value.respecced(describe), name=called)
        return part if pixel_type is None else replace(part, stored=pixel_type, typed=True, exact=output.kind.is_exact)

    def _cryptomatte(self, labels: Sequence[LabelMap], path: Path | None) -> Part:
        """The part of all label maps, with its manifest in metadata or in a file."""
        image = getattr(self.op, self.op.images()[0].attribute).first if getattr(self.op, "onepart", False) else None
        part, whole = cryptomatte_part(labels, path.name if path else None, image)
        if path is not None:
            _write_json(whole, path)
        elif sum(len(name) + 14 for name in whole) > _LARGE:
            log.warning("%s: the manifest is large; write it to a file with cryptomatte=FILE.json", self.op.flag())
        return part


# --- before the work ---


def _require_free(op: Op, files: Mapping[str, Path], written: set[str]) -> None:
    """Refuse files that would overwrite others, or that cannot be written."""
    taken = _read_by(op, {op.output(name).asked_by for name in files})
    holders: dict[Path, list[Output]] = defaultdict(list)
    for name, path in files.items():
        output = op.output(name)
        request, real = f"{output.asked_by}={path}", os.path.realpath(path)
        if path not in holders:
            if real in taken:
                raise ParameterError(f"{request} would overwrite {taken[real]}")
            if real in written:
                raise ParameterError(f"{request} would overwrite a file written by an earlier op")
            taken[real] = request
        elif holders[path][0].asked_by != output.asked_by:
            raise ParameterError(f"{request} would overwrite {taken[real]}")
        holders[path].append(output)
    for path, outputs in holders.items():
        if all(output.kind.is_image and output.kind is not Kind.CRYPTOMATTE for output in outputs):
            require_writable(Image(tuple(_pixel_of(output) for output in outputs)), path, _type_of(outputs[0]))
        else:
            require_place(path)
            if outputs[0].kind is Kind.PAINTS:
                require_palette(path)


def _read_by(op: Op, asking: set[str]) -> dict[str, str]:
    """Real paths of the op's inputs, with descriptions; parameters in `asking` name outputs."""
    names = {}
    for slot, image in op.given():
        names[os.path.realpath(image.source)] = f"{slot.name}, an input image"
    for parameter in op.parameters():
        value = getattr(op, parameter.attribute)
        if isinstance(value, Path) and parameter.attribute not in asking:
            names[os.path.realpath(value)] = f"{parameter.name}, an input file"
    return names


def _type_of(output: Output) -> oiio.TypeDesc | None:
    """The pixel type of an output's kind; None for that of its image."""
    name = _TYPES.get(output.kind)
    return oiio.TypeDesc(name) if name else None


def _pixel_of(output: Output) -> Part:
    """A part of one pixel with the same requirements for a format as the output."""
    kind = _type_of(output)
    spec = oiio.ImageSpec(1, 1, 3 if output.kind is Kind.PICTURE else 2, kind or oiio.TypeDesc(oiio.UINT8))
    return Part(output.name, spec, lambda window: np.zeros((1, 1, spec.nchannels)), kind, exact=output.kind.is_exact)


# --- metadata and results ---


def _sources(op: Op) -> Sequence[tuple[str, Part | None]]:
    """Names and parts of the sources of the op's images, one for each map of a material."""
    slots = (*op.images()[:1], op.further_images())
    named = [(image.source, image.first) for slot, image in op.given() if slot in slots]
    if any(slot.many for slot in op.images()[:1]):  # the first stands for all
        named = named[:1]
    files = [(str(value), None) for value in op.values().values() if isinstance(value, Path)]
    return named or files or [(op.name, None)]


def _facts(op: Op) -> dict[str, Any]:
    """Metadata about how the op's images were made; `_photo` gives that about their source."""
    facts = op.provenance()
    return facts | {"oiiotex:version": __version__} if facts else {}


def _photo(op: Op, name: str, part: Part | None) -> dict[str, str]:
    """The name of the photo, and the hash of its pixels as printed by --hash; taken from its metadata if present.

    Pointwise and neighborhood ops and images not yet computed get no hash, which would require reading all pixels.
    """
    if part is None:
        return {SOURCE: os.path.basename(name)}
    source = part.spec.get_string_attribute(SOURCE) or os.path.basename(name)
    if " SHA-1 " not in source and (op.copies or (part.ready and not isinstance(op, (Pointwise, Neighborhood)))):
        with contextlib.suppress(ImageError):  # no hash for mixed channel types; errors of reading are raised later
            source += f" SHA-1 {sha1(part)}"
    return {SOURCE: source}


def _names(parts: Sequence[Part], main: str) -> tuple[str, ...]:
    """The names of the parts; the first is the op's image unless the input is kept."""
    names = [part.name for part in parts]
    return (main or names[0], *names[1:]) if main not in names[1:] else tuple(names)


def _picture(name: str, picture: np.ndarray | Part) -> Part:
    """A picture as an 8-bit sRGB part."""
    if not isinstance(picture, Part):
        pixels = picture if picture.dtype == np.uint8 else np.rint(np.clip(picture, 0, 1) * 255).astype(np.uint8)
        spec = oiio.ImageSpec(pixels.shape[1], pixels.shape[0], 3, oiio.TypeDesc(_TYPES[Kind.PICTURE]))
        picture = from_pixels(name, pixels, spec)
    picture = _saying(picture, {"oiio:subimagename": name}).respecced(
        lambda spec: tag_colors(spec, "srgb_rec709_scene")
    )
    return replace(picture, name=name, stored=picture.spec.format)


def _write_json(facts: Any, path: Path) -> None:
    """Write facts to a file, atomically."""
    with temporary_beside(path) as temporary:
        temporary.write_text(json.dumps(facts, indent=1))


def _saying(part: Part, facts: dict[str, Any]) -> Part:
    """The part with facts as metadata."""

    def mark(spec: oiio.ImageSpec) -> None:
        for name, value in facts.items():
            note(spec, name, value)

    return part.respecced(mark) if facts else part
