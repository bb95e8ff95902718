# SPDX-License-Identifier: Apache-2.0
"""Command line of `oiiotex-library`: arguments, commands and their output."""

from __future__ import annotations

import argparse
import contextlib
import json
import logging
import math
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

from oiiotex import __version__
from oiiotex.engine.errors import Error, ParameterError, one_line

if TYPE_CHECKING:
    from ..api.lines import Display
    from .catalog import Catalog
    from .search import AssetSearch

_SHARE = re.compile(r"([1-9]\d{0,5})/([1-9]\d{0,5})", re.ASCII)
_LENGTHS = re.compile(r"(\d{1,6}(?:\.\d{1,9})?)x(\d{1,6}(?:\.\d{1,9})?)", re.ASCII)
_MOST_SEED = 2**32 - 1
_LOG = "ingest.log"


def run(words: list[str]) -> int:
    """Run a command line, and return the exit code."""
    given = _parser().parse_args(words or ["--help"], argparse.Namespace(words=words))
    level = logging.INFO if given.debug else logging.ERROR
    logging.basicConfig(format="%(message)s", level=level)
    logging.getLogger("oiiotex").setLevel(level)
    return int(given.work(given))


class _Parser(argparse.ArgumentParser):
    """An argument parser that raises ParameterError: one line, exit code 1."""

    def error(self, message: str) -> NoReturn:
        """Raise a ParameterError."""
        raise ParameterError(f"{message}; see {self.prog} --help")


def _parser() -> _Parser:
    parser = _Parser(
        prog="oiiotex-library", description="Build and search a library of materials from a folder of photos."
    )
    parser.add_argument("--version", action="version", version=f"oiiotex {__version__}")
    commands = parser.add_subparsers(title="commands", required=True, metavar="COMMAND", parser_class=_Parser)

    def command(name: str, work, text: str, library: bool = True) -> argparse.ArgumentParser:  # type: ignore[no-untyped-def]
        own = commands.add_parser(name, help=text, description=text)
        own.add_argument("--debug", action="store_true", help="Log details, and print the traceback of an error.")
        own.set_defaults(work=work)
        if library:
            own.add_argument("library", type=_path, metavar="LIBRARY", help="Folder of the library.")
        return own

    command("recipe", _recipe, "Print a commented recipe.", library=False)
    own = command("ingest", _ingest, "Create or update a library from a folder of photos.", library=False)
    add = own.add_argument
    add("photos", type=_path, metavar="PHOTOS", help="Folder of photos and maps.")
    add("library", type=_path, metavar="LIBRARY", help="Folder of the library.")
    add("--recipe", type=_path, required=True, metavar="FILE", help="Recipe (TOML): which products to make, and how.")
    text = "Number of worker processes. Default: number of threads."
    add("--workers", type=_number, default=0, metavar="N", help=text)
    text = "Memory budget of all workers together, in MB. Default: a quarter of the memory."
    add("--cache", type=_number, default=0, metavar="MB", help=text)
    text = "Run on a farm: dask=tcp://HOST:PORT, dask=local:N or openjd=FILE[,SHARES]."
    add("--farm", default="", metavar="ENGINE", help=text)
    text = "Make only share I of N. A later run records the results in the catalog."
    add("--share", default="", metavar="I/N", help=text)
    add("--join", action="store_true", help="Record the results of shares, and make missing assets.")
    add("--openjd", action="store_true", help="Print progress for Open Job Description runners.")
    add("-q", "--quiet", action="store_true", help="Print neither assets nor progress.")
    _add_search(command("list", _list, "List assets."))
    own = command("show", _show, "Print all data of an asset as JSON.")
    own.add_argument("name", metavar="NAME", help="Name of the asset.")
    command("check", _check, "Verify the hashes and documents of all assets. Exit code 1 if there are errors.")
    command("gc", _gc, "Remove replaced assets and leftovers of killed runs.")
    own = command("export", _export, "Copy assets to a folder, each in a subfolder with its name.")
    own.add_argument("target", type=_path, metavar="FOLDER", help="Target folder, outside the library.")
    _add_search(own, "ok")
    text = "Deliver atlases of Wang tiles to renderers: MaterialX, USD, shaders and a web page that shows the plane."
    own = command("wang", _wang, text, library=False)
    _add_atlases(own, "--texstationarize:pack=atlas")
    add = own.add_argument
    add("--seed", type=_number, default=0, metavar="N", help="Arrangement of the tiles, as in an .oiiotex file.")
    text = "Width and height of a tile in units of texture coordinates, such as meters. Default: 1x1."
    add("--size", default="1x1", metavar="WxH", help=text)
    text = "Distance between heights 0 and 1, in the same units. Default: heights are not connected."
    add("--relief", type=float, default=0.0, metavar="LENGTH", help=text)
    text = "Convention of the normals. Default: opengl."
    add("--normals", default="opengl", choices=("opengl", "directx"), help=text)
    text = "Deliver atlases of two materials to editors of tile maps: a tile set and a map for Tiled, one for Godot."
    own = command("tileset", _tileset, text, library=False)
    _add_atlases(own, "--textransition")
    add = own.add_argument
    text = "Names of the two materials, such as grass,sand. Default: first,second."
    add("--materials", default="first,second", metavar="NAME,NAME", help=text)
    return parser


def _add_atlases(parser: argparse.ArgumentParser, made_by: str) -> None:
    add = parser.add_argument
    add("folder", type=_path, metavar="FOLDER", help="Target folder.")
    text = f"Atlas of a map, made with {made_by}: color=FILE, normal=FILE, height=FILE ..."
    add("maps", nargs="+", metavar="ROLE=FILE", help=text)
    add("--name", default="", help="Name of the material. Default: name of the folder.")


def _add_search(parser: argparse.ArgumentParser, status: str = "") -> None:
    add = parser.add_argument_group("search").add_argument
    add("--name", default="", metavar="PATTERN", help="Name of the asset, with wildcards * and ?.")
    text = "Status of the asset." + (f" Default: {status}." if status else "")
    add("--status", default=status, choices=("ok", "review", "failed", "asked"), help=text)
    add("--tag", default="", help="Tag of the asset.")
    text = "Limit of a measure, such as 'seam<1.2'. Can be repeated: all must hold."
    add("--measure", action="append", default=[], metavar="LIMIT", help=text)
    add("--color", default="", metavar="RRGGBB", help="Mean color in sRGB. Sorts by color distance.")
    text = "Maximum distance (CIE Lab) from a color. Default: 15."
    add("--distance", type=float, default=15.0, metavar="LAB", help=text)
    text = "Size in pixels, or in meters with m. >: at least, <: at most."
    add("--size", default="", metavar="[<>]WxH[m]", help=text)
    text = "Label NAME (with wildcards) or #RRGGBB, optionally with a minimum share: 'moss>0.2' for more than 20 %%."
    add("--label", default="", metavar="TERM", help=text)


def _path(text: str) -> Path:
    if not text:  # Path("") is the current folder
        raise argparse.ArgumentTypeError("'': expected a path")
    return Path(text)


def _number(text: str) -> int:
    if not (text.isascii() and text.isdigit()):
        raise argparse.ArgumentTypeError(f"'{text}': expected an integer >= 0")
    return int(text)


# --- commands ---


def _recipe(given: argparse.Namespace) -> int:
    from ..recipes.recipe import commented_recipe

    print(commented_recipe(), end="")
    return 0


def _ingest(given: argparse.Namespace) -> int:
    from ..api.lines import forget_current_folder
    from ..recipes.lines import require_lines
    from ..recipes.recipe import load_recipe

    forget_current_folder()
    recipe = load_recipe(given.recipe)
    require_lines(recipe)
    if given.farm.startswith("openjd="):
        return _write_template(given)
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

    blender_list(given.library)  # fail now if Blender's list cannot be written at the end
    settings = IngestSettings(workers, given.cache << 20, address, share)
    lines: list[str] = []

    def say(text: str) -> None:
        lines.append(one_line(text))
        with contextlib.suppress(OSError), open(given.library / _LOG, "a") as log:
            log.write(f"{lines[-1]}\n")  # at once, because a run can be killed
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
        counts = (
            ", ".join(f"{count} {status}" for status, count in sorted(tally.counts.items())) or "no materials found"
        )
        print(f"{tally.made} made, {tally.unchanged} unchanged: {counts}; {tally.seconds:.1f} s")
    return tally.status


@contextlib.contextmanager
def _display(given: argparse.Namespace) -> Iterator[Display]:
    from ..api.lines import Display, tell_runner

    display = Display()
    if given.openjd:
        display.advance = tell_runner  # type: ignore[method-assign]
    if given.quiet or given.openjd:
        yield display
        return
    with display.shown():
        yield display


def _write_template(given: argparse.Namespace) -> int:
    from ..farm.openjd import LEAST_MEMORY, place_of, share_template, write_template

    path, shares = place_of(given.farm.removeprefix("openjd="))
    line = list(given.words)
    at = next(n for n, word in enumerate(line) if word.startswith("--farm"))
    del line[at : at + (1 if "=" in line[at] and line[at].startswith("--farm=") else 2)]
    memory = given.cache or LEAST_MEMORY
    template = share_template(path.stem, line, shares, memory, program="oiiotex-library")
    write_template(path, template, line)
    return 0


def _search(given: argparse.Namespace) -> AssetSearch:
    from .search import AssetSearch

    return AssetSearch(
        given.name, given.status, given.tag, tuple(given.measure), given.color, given.distance, given.size, given.label
    )


def _list(given: argparse.Namespace) -> int:
    with _catalog(given) as catalog:
        chosen = _search(given).assets(catalog)
    lines = []
    for asset, measures in chosen:
        size = f"{asset.width}x{asset.height}" if asset.width else "-"
        own = [f"{name}={measures[name]:.3g}" for name in ("seam", "repeat", "loss") if name in measures]
        lines.append("  ".join((asset.name, asset.status, size, *own, "; ".join(asset.reasons))).rstrip())
    print("\n".join(map(one_line, lines)) or "no matching assets")
    return 0


def _show(given: argparse.Namespace) -> int:
    from .upkeep import shown

    with _catalog(given) as catalog:
        print(json.dumps(shown(catalog, given.name), indent=1, ensure_ascii=False))
    return 0


def _check(given: argparse.Namespace) -> int:
    from .upkeep import check, orphans

    with _catalog(given) as catalog:
        faults = list(check(catalog))
        left, count = len(orphans(catalog)), len(catalog.assets())
    for fault in faults:
        print(one_line(fault))
    print(f"{count} assets, {len(faults)} errors" + (f"; {left} replaced folders (gc removes them)" if left else ""))
    return 1 if faults else 0


def _gc(given: argparse.Namespace) -> int:
    from .upkeep import collect_garbage

    with _catalog(given) as catalog:
        folders, freed = collect_garbage(catalog)
    print(f"{folders} folders removed, {freed / 1e6:.1f} MB")
    return 0


def _export(given: argparse.Namespace) -> int:
    from .export import export

    with _catalog(given) as catalog:
        chosen = [asset for asset, _ in _search(given).assets(catalog) if asset.folder]
        if not chosen:
            raise Error("no matching assets to export; change the search options")
        count = export(catalog, given.target, chosen, lambda name: print(one_line(name)))
    print(f"{count} copied, {len(chosen) - count} unchanged")
    return 0


def _wang(given: argparse.Namespace) -> int:
    from .wang import delivered, side_of, write_wang

    size = _LENGTHS.fullmatch(given.size)
    if not size or not min(map(float, size.groups())) > 0:
        raise ParameterError(f"--size {given.size}: expected WIDTHxHEIGHT, such as 2x1.5")
    files, name = _atlases(given)
    if not 0 <= given.relief < math.inf:
        raise ParameterError(f"--relief {given.relief}: expected a number >= 0")
    if given.relief and "height" not in files:
        raise ParameterError(f"--relief {given.relief:g}: requires height=FILE")
    if given.seed > _MOST_SEED:
        raise ParameterError(f"--seed {given.seed}: expected an integer from 0 to {_MOST_SEED}")
    how = name, given.seed, (float(size[1]), float(size[2])), given.relief, given.normals
    print("\n".join(delivered(files, given.folder, name, side_of, lambda atlases, at: write_wang(atlases, at, *how))))
    return 0


def _tileset(given: argparse.Namespace) -> int:
    from .tileset import checked, write_tileset
    from .wang import delivered

    files, name = _atlases(given)
    names = given.materials.split(",")
    if len(names) != 2 or not all(one and one.isprintable() for one in names):
        raise ParameterError(f"--materials {given.materials}: expected two names, such as grass,sand")
    first, second = names
    written = delivered(
        files, given.folder, name, checked, lambda atlases, at: write_tileset(atlases, at, name, (first, second))
    )
    print("\n".join(written))
    return 0


def _atlases(given: argparse.Namespace) -> tuple[dict[str, Path], str]:
    """The given atlases by role, and the name of what is delivered."""
    from ..api.files import checked_name
    from ..materials.naming import PACKED, ROLES

    files, roles = dict[str, Path](), [role for role in ROLES if role != PACKED]
    for word in given.maps:
        role, equals, file = word.partition("=")
        if not (equals and file and role in roles) or role in files:
            raise ParameterError(f"{word}: expected ROLE=FILE, once for each of {', '.join(roles)}")
        files[role] = Path(file)
    if given.folder.exists() and not given.folder.is_dir():
        raise ParameterError(f"{given.folder}: expected a folder, but it is a file")
    return files, checked_name(given.name or given.folder.resolve().name, "--name")


def _catalog(given: argparse.Namespace) -> Catalog:
    from .catalog import Catalog

    return Catalog(given.library)
