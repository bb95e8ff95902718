# SPDX-License-Identifier: Apache-2.0
"""What `oiiotex-library` does: its words, and what is printed."""

from __future__ import annotations

import argparse
import contextlib
import json
import logging
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

from .. import __version__
from ..errors import Error, ParameterError, one_line

if TYPE_CHECKING:
    from ..api.lines import Display
    from .catalog import Catalog
    from .search import AssetSearch

_SHARE = re.compile(r"([1-9]\d{0,5})/([1-9]\d{0,5})", re.ASCII)
_LEAST_MEMORY = 2048  # MB that a task of a job template asks for, when the line does not say
_LOG = "ingest.log"


def run(words: list[str]) -> int:
    """Do what a command line says; returns the exit code."""
    given = _parser().parse_args(words or ["--help"])
    level = logging.INFO if given.debug else logging.ERROR
    logging.basicConfig(format="%(message)s", level=level)
    logging.getLogger("oiiotex").setLevel(level)
    return int(given.work(given, words))


class _Parser(argparse.ArgumentParser):
    """Its errors are ours: one line, exit 1."""

    def error(self, message: str) -> NoReturn:
        """Raise what is wrong."""
        raise ParameterError(f"{message}: {self.prog} --help lists what is allowed")


def _parser() -> _Parser:
    parser = _Parser(prog="oiiotex-library", description="A library of materials from a folder of photos.")
    parser.add_argument("--version", action="version", version=f"oiiotex {__version__}")
    commands = parser.add_subparsers(title="commands", required=True, metavar="COMMAND", parser_class=_Parser)

    def command(name: str, work, text: str, library: bool = True) -> argparse.ArgumentParser:  # type: ignore[no-untyped-def]
        own = commands.add_parser(name, help=text, description=text)
        own.add_argument("--debug", action="store_true", help="say where an error comes from")
        own.set_defaults(work=work)
        if library:
            own.add_argument("library", type=_path, metavar="LIBRARY")
        return own

    command("recipe", _recipe, "print a commented recipe", library=False)
    own = command("ingest", _ingest, "bring a library up to date with a folder of photos", library=False)
    own.add_argument("photos", type=_path, metavar="PHOTOS")
    own.add_argument("library", type=_path, metavar="LIBRARY")
    own.add_argument("--recipe", type=_path, required=True, metavar="FILE", help="what is made, and how")
    own.add_argument("--workers", type=_number, default=0, metavar="N", help="processes; as many as threads by default")
    own.add_argument("--cache", type=_number, default=0, metavar="MB", help="memory of all of them")
    own.add_argument("--farm", default="", metavar="ENGINE", help="dask=tcp://HOST:PORT, dask=local:N, openjd=FILE[,N]")
    own.add_argument("--share", default="", metavar="I/N", help="make share I of N; a later run records it")
    own.add_argument("--join", action="store_true", help="the run that records shares, and makes what is missing")
    own.add_argument("--openjd", action="store_true", help="tell progress as Open Job Description's runners read it")
    own.add_argument("-q", "--quiet", action="store_true", help="no line for an asset, no progress")
    _add_search(command("list", _list, "list assets"))
    own = command("show", _show, "print all that is known of an asset, as JSON")
    own.add_argument("name", metavar="NAME")
    command("check", _check, "hash and validate everything; exit 1 where something is wrong")
    command("gc", _gc, "remove what newer assets have replaced, and what killed runs have left")
    own = command("export", _export, "copy assets into a folder, each under its name")
    own.add_argument("target", type=_path, metavar="FOLDER")
    _add_search(own, "ok")
    return parser


def _add_search(parser: argparse.ArgumentParser, status: str = "") -> None:
    group = parser.add_argument_group("search")
    group.add_argument("--name", default="", metavar="PATTERN", help="with * and ?")
    choices = ("ok", "review", "failed", "asked")
    group.add_argument("--status", default=status, choices=choices)
    group.add_argument("--tag", default="")
    group.add_argument("--measure", action="append", default=[], metavar="LIMIT", help="such as seam<1.2; all hold")
    group.add_argument("--color", default="", metavar="RRGGBB", help="sRGB; the nearest mean colors come first")
    group.add_argument("--distance", type=float, default=15.0, metavar="LAB", help="from --color at most (15)")
    group.add_argument("--size", default="", metavar="[<>]WxH[m]", help="px, or meters; > or <: at least or at most")
    text = "NAME or #RRGGBB of labels; behind it >0.2: of more than a fifth"
    group.add_argument("--label", default="", metavar="TERM", help=text)


def _path(text: str) -> Path:
    if not text:  # which a Path takes for the current folder
        raise argparse.ArgumentTypeError("'': expected a path")
    return Path(text)


def _number(text: str) -> int:
    if not (text.isascii() and text.isdigit()):
        raise argparse.ArgumentTypeError(f"'{text}': expected a whole number")
    return int(text)


# --- commands ---


def _recipe(given: argparse.Namespace, words: list[str]) -> int:
    from ..recipes.recipe import commented_recipe

    print(commented_recipe(), end="")
    return 0


def _ingest(given: argparse.Namespace, words: list[str]) -> int:
    from ..api.lines import forget_current_folder
    from ..recipes.lines import require_lines
    from ..recipes.recipe import load_recipe

    forget_current_folder()
    recipe = load_recipe(given.recipe)
    require_lines(recipe)
    if given.farm.startswith("openjd="):
        return _write_template(given, words)
    workers, address = given.workers, ""
    if given.farm:
        engine, _, address = given.farm.partition("=")
        if engine != "dask":
            raise ParameterError(f"--farm {given.farm}: expected dask=tcp://HOST:PORT, dask=local:N or openjd=FILE[,N]")
        from ..farm.dask_cluster import local_workers

        if local := local_workers(address):
            workers, address = local, ""
    share = (0, 0)
    if given.share:
        match = _SHARE.fullmatch(given.share)
        if not match or int(match[1]) > int(match[2]) or given.join:
            raise ParameterError(f"--share {given.share}: expected I/N, I from 1 to N, N to 999999, without --join")
        share = int(match[1]), int(match[2])
    from .catalog import Catalog
    from .export import blender_list, write_blender
    from .ingest import IngestSettings, ingest
    from .report import write_report

    blender_list(given.library)  # what cannot be written in the end is said now
    settings = IngestSettings(workers, given.cache << 20, address, share)
    lines: list[str] = []

    def say(text: str) -> None:
        lines.append(one_line(text))
        with contextlib.suppress(OSError), open(given.library / _LOG, "a") as log:
            log.write(f"{lines[-1]}\n")  # at once: a run may be killed
        if not given.quiet:
            display.print(lines[-1])
            sys.stdout.flush()

    with _display(given) as display:
        tally = ingest(given.photos, given.library, recipe, settings, say, display)
    if share == (0, 0) and (tally.made or lines or not (given.library / "report.html").is_file()):
        with Catalog(given.library) as catalog:
            write_blender(catalog, given.library)
            write_report(catalog, given.library.resolve().name)
    if not given.quiet:
        counts = ", ".join(f"{count} {status}" for status, count in sorted(tally.counts.items())) or "nothing found"
        print(f"{tally.made} made, {tally.unchanged} unchanged: {counts}; {tally.seconds:.1f} s")
    return tally.status


@contextlib.contextmanager
def _display(given: argparse.Namespace) -> Iterator[Display]:
    from ..api.lines import Display

    display = Display()
    if given.openjd:
        advance = display.advance

        def tell(done: int, total: int) -> None:
            advance(done, total)
            print(f"openjd_progress: {100 * done / max(total, 1):.1f}", flush=True)

        display.advance = tell  # type: ignore[method-assign]
    if given.quiet or given.openjd:
        yield display
        return
    with display.shown():
        yield display


def _write_template(given: argparse.Namespace, words: list[str]) -> int:
    from ..farm.openjd import place_of, share_template, write_template

    path, shares = place_of(given.farm.removeprefix("openjd="))
    line = list(words)
    at = next(n for n, word in enumerate(line) if word.startswith("--farm"))
    del line[at : at + (1 if "=" in line[at] and line[at].startswith("--farm=") else 2)]
    memory = given.cache or _LEAST_MEMORY
    template = share_template(path.stem, line, shares, memory, program="oiiotex-library")
    write_template(path, template, line)
    return 0


def _search(given: argparse.Namespace) -> AssetSearch:
    from .search import AssetSearch

    return AssetSearch(
        given.name, given.status, given.tag, tuple(given.measure), given.color, given.distance, given.size, given.label
    )


def _list(given: argparse.Namespace, words: list[str]) -> int:
    with _catalog(given) as catalog:
        chosen = _search(given).assets(catalog)
    lines = []
    for asset, measures in chosen:
        size = f"{asset.width}x{asset.height}" if asset.width else "-"
        own = [f"{name}={measures[name]:.3g}" for name in ("seam", "repeat", "loss") if name in measures]
        lines.append("  ".join((asset.name, asset.status, size, *own, "; ".join(asset.reasons))).rstrip())
    print("\n".join(map(one_line, lines)) or "no asset")
    return 0


def _show(given: argparse.Namespace, words: list[str]) -> int:
    from .upkeep import shown

    with _catalog(given) as catalog:
        print(json.dumps(shown(catalog, given.name), indent=1, ensure_ascii=False))
    return 0


def _check(given: argparse.Namespace, words: list[str]) -> int:
    from .upkeep import check, orphans

    with _catalog(given) as catalog:
        faults = list(check(catalog))
        left, count = len(orphans(catalog)), len(catalog.assets())
    for fault in faults:
        print(one_line(fault))
    print(f"{count} assets, {len(faults)} faults" + (f"; {left} folders that gc removes" if left else ""))
    return 1 if faults else 0


def _gc(given: argparse.Namespace, words: list[str]) -> int:
    from .upkeep import collect_garbage

    with _catalog(given) as catalog:
        folders, freed = collect_garbage(catalog)
    print(f"{folders} folders removed, {freed / 1e6:.1f} MB")
    return 0


def _export(given: argparse.Namespace, words: list[str]) -> int:
    from .export import export

    with _catalog(given) as catalog:
        chosen = [asset for asset, _ in _search(given).assets(catalog) if asset.folder]
        if not chosen:
            raise Error("no asset fits: nothing to export")
        count = export(catalog, given.target, chosen, lambda name: print(one_line(name)))
    print(f"{count} copied, {len(chosen) - count} as they were")
    return 0


def _catalog(given: argparse.Namespace) -> Catalog:
    from .catalog import Catalog

    return Catalog(given.library)
