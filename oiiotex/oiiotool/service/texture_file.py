# SPDX-License-Identifier: Apache-2.0
"""`wall.oiiotex`: a small JSON document that hosts open as an unbounded texture image.

    {"oiiotex": 1, "photo": "gravel.exr", "size": "1048576x1048576", "seed": 7, "colorspace": "ACEScg"}

`oiiotex` is the version of the format. `photo` is the exemplar, or `graph` an exemplar graph. All these files must be
inside the document's folder or a folder in $OIIOTEX_TEXTURE_PATH (separated as in $PATH), with symbolic links resolved:
an untrusted document cannot show other files of its reader. `size` is the size of the image, `lod` as in
--texsynth (default: the finest), `colorspace` the color space of an untagged photo. `autocc` derives color spaces from
file names. `device` is as in --device. A query after the file name, such as `?seed=7&size=4096x4096`, overrides seed,
size, lod, colorspace or device.

With `plan`, a file of --texquilt:planfile, the texture is that quilt of the photo, or of another map of the same size.
With `tiles` instead of a photo, a file of --texstationarize:variants, `seed` arranges these tiles over the plane.

A file with this suffix can also be an indexed image (`engine.io.copies`). It names no other file.
"""

from __future__ import annotations

import json
import os
import re
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from ...engine.errors import ImageError
from ...engine.io.copies import is_indexed
from ...engine.io.documents import read_document
from ...engine.io.schema import Allowed, Seed, read_as
from ...engine.session import Session
from ...synthesis.multiscale.graph import read_graph
from ...synthesis.multiscale.synthesizer import MOST_LEVEL
from .settings import ResidentSettings

FOLDERS = "OIIOTEX_TEXTURE_PATH"
MOST_NAME, MOST_QUERY, MOST_TEXT = 4096, 1000, 1000  # characters of a file name, of the query, of a value
MOST_SIDE = 2**31 - 1024  # px: OpenImageIO uses 32-bit integers, and adds a tile
_TILES = (64, 128, 256, 512, 1024)  # px; tile sizes reported to hosts
_MOST_TILES = 1 << 28  # per level: OpenImageIO's cache keeps a bit for each tile, with 32-bit indices
_FILES = ("photo", "graph", "tiles", "plan", "indexed")
_QUERY = ("seed", "size", "lod", "colorspace", "device")
_SIZE = re.compile(r"([1-9]\d{0,9})x([1-9]\d{0,9})", re.ASCII)


_LinkedText = Annotated[
    str, Allowed(most=MOST_TEXT, pattern=r"(?s)[^\0]+", words=f"of 1 to {MOST_TEXT} characters without NUL")
]


@dataclass(frozen=True, kw_only=True)
class _TextureDocument:
    """A document, with the values of the query."""

    oiiotex: Annotated[Literal[1], Allowed(words="(the version of the format)")]
    photo: _LinkedText | None = None
    graph: _LinkedText | None = None
    tiles: _LinkedText | None = None
    size: str | None = None
    plan: _LinkedText | None = None
    seed: Seed | None = None
    lod: Annotated[int, Allowed(0, MOST_LEVEL)] | None = None
    colorspace: _LinkedText | None = None
    autocc: bool = False
    device: _LinkedText | None = None
    title: Any = None  # comments
    note: Any = None


def tile_side(width: int, height: int) -> int:
    """The tile size of an image in pixels: 64, or larger to limit the number of tiles; 0 if there is none."""
    fits = (n for n in _TILES if -(-width // n) * -(-height // n) <= _MOST_TILES)
    return next(fits, 0)


@dataclass(frozen=True, kw_only=True)
class TextureFile:
    """A checked document. Paths are absolute.

    Exactly one of photo, graph, tiles and indexed is set; plan requires photo.
    """

    name: str  # of the file, for messages
    photo: str | None
    graph: str | None
    tiles: str | None
    plan: str | None
    indexed: str | None = None  # an indexed image, the file itself
    stamp: tuple[int, ...]  # modification time (ns) and size of each file; a change makes another texture
    width: int  # px, 1 to 2^31 - 1024; 0 with a plan or an index, which define them
    height: int
    seed: int | None = None  # of --texsynth, as is lod
    lod: int | None = None
    colorspace: str | None = None
    device: str | None = None
    autocc: bool = False

    def text(self) -> str:
        """The texture as JSON, its key in the resident process."""
        return json.dumps(asdict(self), sort_keys=True)

    @classmethod
    def of_text(cls, text: str) -> TextureFile:
        """The texture that `text` has written."""
        facts = json.loads(text)
        return cls(**facts | {"stamp": tuple(facts["stamp"])})

    def settings(self) -> ResidentSettings:
        """The settings of the resident process that renders it."""
        return ResidentSettings.of(Session(device_name=self.device, autocc=self.autocc))

    def require_unchanged(self) -> None:
        """Raise ImageError if a file has changed since the host opened the texture."""
        files = list(filter(None, (getattr(self, key) for key in _FILES)))
        if _stamp(self.name, files) != self.stamp:
            raise ImageError(f"{self.name}: {' or '.join(files)} has changed since it was opened; open it again")


def read_texture_file(name: str) -> TextureFile:
    """Read a texture file; its name can end with a query."""
    query = ""
    if "?" in name and not _exists(name):
        name, _, query = name.partition("?")
    for text, most, called in ((name, MOST_NAME, "the file name"), (query, MOST_QUERY, "the query after '?'")):
        if len(text) > most or "\0" in text:
            raise ImageError(f"{name[:300]}: {called} has {len(text)} characters: expected at most {most}, without NUL")
    path = Path(name)
    where = str(path)
    if is_indexed(path):
        return _indexed(path, query)
    document = read_document(path)
    if query and isinstance(document, dict):
        document |= _asked(query, where)
    return _checked(read_as(_TextureDocument, document, where), path)


def _indexed(path: Path, query: str) -> TextureFile:
    if query:
        raise ImageError(f"{path}: '?{query[:60]}': an indexed image has no settings: expected no query")
    name = os.path.abspath(path)
    stamp = _stamp(str(path), [name])
    return TextureFile(
        name=name, indexed=name, stamp=stamp, photo=None, graph=None, tiles=None, plan=None, width=0, height=0
    )


def _asked(query: str, where: str) -> dict[str, Any]:
    """The values of a query by name: integers and strings."""
    values: dict[str, Any] = {}
    for word in filter(None, query.split("&")):
        key, _, value = word.partition("=")
        if key not in _QUERY:
            raise ImageError(f"{where}: '?{word[:60]}': expected {', '.join(_QUERY)}")
        values[key] = int(value) if key in ("seed", "lod") and value.isascii() and value.isdigit() else value
    return values


def _checked(document: _TextureDocument, path: Path) -> TextureFile:
    where = str(path)
    given = [key for key in _FILES[:3] if getattr(document, key) is not None]
    if len(given) != 1:
        raise ImageError(f"{where}: expected one of photo, graph and tiles, not {' and '.join(given) or 'none'}")
    if document.plan is not None:
        for key in ("graph", "tiles", "size", "seed", "lod"):
            if getattr(document, key) is not None:
                raise ImageError(f"{where}: {key} conflicts with plan, which requires a photo and defines the rest")
        given.append("plan")
    if document.tiles is not None and document.lod is not None:
        raise ImageError(f"{where}: lod conflicts with tiles, which have one level")
    if document.graph is not None and document.colorspace is not None:
        raise ImageError(f"{where}: colorspace requires photo; tag the files of the graph, or use autocc")
    files = {key: os.path.abspath(path.parent / getattr(document, key)) for key in given}
    _require_allowed(files, path)
    width, height = (0, 0) if "plan" in given else _size(document.size, where)
    return TextureFile(
        name=os.path.abspath(where), stamp=_stamp(where, list(files.values())), width=width, height=height,
        autocc=document.autocc, **{key: files.get(key) for key in _FILES},
        seed=document.seed, lod=document.lod, colorspace=document.colorspace, device=document.device,
    )  # fmt: skip


def _size(size: str | None, where: str) -> tuple[int, int]:
    match = _SIZE.fullmatch(size or "")
    if not match or max(map(int, match.groups())) > MOST_SIDE:
        given = "size is missing" if size is None else f"size={size[:60]}"
        raise ImageError(f"{where}: {given}: expected WIDTHxHEIGHT, each from 1 to {MOST_SIDE} px (2^31 - 1024)")
    width, height = map(int, match.groups())
    if not tile_side(width, height):
        raise ImageError(
            f"{where}: size={size}: too many tiles for OpenImageIO's cache (at most {_MOST_TILES} of {_TILES[-1]} px):"
            " expected at most 2^48 px in total, such as 16777216x16777216"
        )
    return width, height


def _exists(name: str) -> bool:
    try:
        os.stat(name)
    except (OSError, ValueError):  # such as a name that is too long
        return False
    return True


def _require_allowed(files: dict[str, str], path: Path) -> None:
    """Raise ImageError for files outside the document's folder and the folders of $OIIOTEX_TEXTURE_PATH."""
    folders = [path.parent, *map(Path, filter(os.path.isabs, os.environ.get(FOLDERS, "").split(os.pathsep)))]
    allowed = [Path(os.path.realpath(folder)) for folder in folders]

    def require(key: str, file: str) -> None:
        real = Path(os.path.realpath(file))
        if not any(real.is_relative_to(folder) for folder in allowed):
            raise ImageError(
                f"{path}: {key}={file} is outside the document's folder{f' ({real})' if str(real) != file else ''}:"
                f" expected a file in it, or in a folder of ${FOLDERS}"
            )

    for key, file in files.items():
        require(key, file)
    if "graph" in files:
        for named in read_graph(Path(files["graph"])).files:
            require("a file of graph", os.path.abspath(named))


def _stamp(where: str, files: list[str]) -> tuple[int, ...]:
    stamp: list[int] = []
    for file in files:
        try:
            status = os.stat(file)
        except (OSError, ValueError) as error:
            raise ImageError(f"{where}: {file}: {getattr(error, 'strerror', None) or 'no such file'}") from error
        stamp += status.st_mtime_ns, status.st_size
    return tuple(stamp)
