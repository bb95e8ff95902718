# SPDX-License-Identifier: Apache-2.0
"""`wall.oiiotex`: a small document that stands for an endless texture, which hosts open as an image.

    {"oiiotex": 1, "photo": "gravel.exr", "size": "1048576x1048576", "seed": 7, "colorspace": "ACEScg"}

`oiiotex` is the version of the format. `photo` is the one exemplar, or `graph` an exemplar graph. These files and those
that the graph names lie in the document's folder, or below it: a document from a stranger shows no other picture of its
reader. Links count as what they lead to. Folders in $OIIOTEX_TEXTURE_PATH, separated as in $PATH, are allowed, too.
`size` is that of the image, `level` the octaves of --texsynth that it shows (the finest when left out),
`colorspace` says what space an untagged photo is in, `autocc` lets the names of files say it, `device` is as --device.
Behind the file's name `?seed=7&size=4096x4096` says another seed, size, level, colorspace or device.

With `plan`, an archive of --texquilt:plan, it is that quilt of the photo instead, or of any map of the photo's size.
With `tiles` instead of a photo, a file of --texstationarize:variants, these tiles lie beside each other as `seed` says.
"""

from __future__ import annotations

import json
import os
import re
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from ..errors import ImageError
from ..io.documents import read_document
from ..io.schema import Allowed, Seed, read_as
from ..multiscale.graph import read_graph
from ..multiscale.synthesizer import MOST_LEVEL
from ..session import Session
from .settings import ResidentSettings

SUFFIX = ".oiiotex"
FOLDERS = "OIIOTEX_TEXTURE_PATH"
MOST_NAME, MOST_QUERY, MOST_TEXT = 4096, 1000, 1000  # letters of a file's name, of what is behind '?', of a value
MOST_SIDE = 2**31 - 1024  # px: OpenImageIO counts them by 32 bits, with a tile on top
_TILES = (64, 128, 256, 512, 1024)  # px, sides that hosts are told to ask for
_MOST_TILES = 1 << 28  # of a level: OpenImageIO's cache holds a bit for each, and counts them by 32 bits
_FILES = ("photo", "graph", "tiles", "plan")
_QUERY = ("seed", "size", "level", "colorspace", "device")
_SIZE = re.compile(r"([1-9]\d{0,9})x([1-9]\d{0,9})", re.ASCII)


_LinkedText = Annotated[
    str, Allowed(most=MOST_TEXT, pattern=r"(?s)[^\0]+", words=f"of 1 to {MOST_TEXT} letters, none of them NUL")
]


@dataclass(frozen=True, kw_only=True)
class _TextureDocument:
    """What a document says, with what stands behind '?'."""

    oiiotex: Annotated[Literal[1], Allowed(words="(the version of the format)")]
    photo: _LinkedText | None = None
    graph: _LinkedText | None = None
    tiles: _LinkedText | None = None
    size: str | None = None
    plan: _LinkedText | None = None
    seed: Seed | None = None
    level: Annotated[int, Allowed(0, MOST_LEVEL)] | None = None
    colorspace: _LinkedText | None = None
    autocc: bool = False
    device: _LinkedText | None = None
    title: Any = None  # for people
    note: Any = None


def tile_side(width: int, height: int) -> int:
    """The side of an image's tiles, px: 64, more where they would be too many; 0 where they always are."""
    fits = (n for n in _TILES if -(-width // n) * -(-height // n) <= _MOST_TILES)
    return next(fits, 0)


@dataclass(frozen=True, kw_only=True)
class TextureFile:
    """A checked document. Paths are absolute: one of the first three, and a plan with a photo alone."""

    name: str  # the file's, for messages
    photo: str | None
    graph: str | None
    tiles: str | None
    plan: str | None
    stamp: tuple[int, ...]  # when these files were last changed, ns, and their bytes: changed, it is another texture
    width: int  # px, 1 to 2^31 - 1024; 0 where a plan says them
    height: int
    seed: int | None = None  # as of --texsynth, and the level
    level: int | None = None
    colorspace: str | None = None
    device: str | None = None
    autocc: bool = False

    def text(self) -> str:
        """As JSON, by which the resident process knows it."""
        return json.dumps(asdict(self), sort_keys=True)

    @classmethod
    def of_text(cls, text: str) -> TextureFile:
        """What `text` has written."""
        facts = json.loads(text)
        return cls(**facts | {"stamp": tuple(facts["stamp"])})

    def settings(self) -> ResidentSettings:
        """Those of the resident process that makes it."""
        return ResidentSettings.of(Session(device_name=self.device, autocc=self.autocc))

    def require_unchanged(self) -> None:
        """Refuse to go on with other pixels than those that a host has seen."""
        files = list(filter(None, (getattr(self, key) for key in _FILES)))
        if _stamp(self.name, files) != self.stamp:
            raise ImageError(f"{self.name}: {' or '.join(files)} has changed since it was opened: open it again")


def read_texture_file(name: str) -> TextureFile:
    """The texture that a file's name stands for, with what stands behind '?' in it."""
    query = ""
    if "?" in name and not _exists(name):
        name, _, query = name.partition("?")
    for text, most, called in ((name, MOST_NAME, "a file's name"), (query, MOST_QUERY, "what is behind '?'")):
        if len(text) > most or "\0" in text:
            raise ImageError(
                f"{name[:300]}: {called} has {len(text)} letters: expected {most} at most, none of them NUL"
            )
    path = Path(name)
    where = str(path)
    document = read_document(path)
    if query and isinstance(document, dict):
        document |= _asked(query, where)
    return _checked(read_as(_TextureDocument, document, where), path)


def _asked(query: str, where: str) -> dict[str, Any]:
    """What stands behind '?': numbers and texts by name."""
    values: dict[str, Any] = {}
    for word in filter(None, query.split("&")):
        key, _, value = word.partition("=")
        if key not in _QUERY:
            raise ImageError(f"{where}: '?{word[:60]}': expected {', '.join(_QUERY)}")
        values[key] = int(value) if key in ("seed", "level") and value.isascii() and value.isdigit() else value
    return values


def _checked(document: _TextureDocument, path: Path) -> TextureFile:
    where = str(path)
    given = [key for key in _FILES[:3] if getattr(document, key) is not None]
    if len(given) != 1:
        raise ImageError(f"{where}: expected one of photo, graph and tiles, not {' and '.join(given) or 'none'}")
    if document.plan is not None:
        for key in ("graph", "tiles", "size", "seed", "level"):
            if getattr(document, key) is not None:
                raise ImageError(f"{where}: {key} conflicts with plan: a plan is of a photo, and says the rest")
        given.append("plan")
    if document.tiles is not None and document.level is not None:
        raise ImageError(f"{where}: level conflicts with tiles: they have one")
    if document.graph is not None and document.colorspace is not None:
        raise ImageError(f"{where}: colorspace is a photo's; the files of a graph say theirs, or autocc lets names do")
    files = {key: os.path.abspath(path.parent / getattr(document, key)) for key in given}
    _require_allowed(files, path)
    width, height = (0, 0) if "plan" in given else _size(document.size, where)
    return TextureFile(
        name=os.path.abspath(where), stamp=_stamp(where, list(files.values())), width=width, height=height,
        autocc=document.autocc, **{key: files.get(key) for key in _FILES},
        seed=document.seed, level=document.level, colorspace=document.colorspace, device=document.device,
    )  # fmt: skip


def _size(size: str | None, where: str) -> tuple[int, int]:
    match = _SIZE.fullmatch(size or "")
    if not match or max(map(int, match.groups())) > MOST_SIDE:
        given = "size is missing" if size is None else f"size={size[:60]}"
        raise ImageError(f"{where}: {given}: expected WIDTHxHEIGHT, each from 1 to {MOST_SIDE} px (2^31 - 1024)")
    width, height = map(int, match.groups())
    if not tile_side(width, height):
        raise ImageError(
            f"{where}: size={size}: OpenImageIO's cache holds no more than {_MOST_TILES} tiles of {_TILES[-1]} px:"
            " expected at most 2^48 px in all, such as 16777216x16777216"
        )
    return width, height


def _exists(name: str) -> bool:
    try:
        os.stat(name)
    except (OSError, ValueError):  # one that is too long is none
        return False
    return True


def _require_allowed(files: dict[str, str], path: Path) -> None:
    """Refuse files elsewhere than in the document's folder and those that the user has allowed."""
    folders = [path.parent, *map(Path, filter(os.path.isabs, os.environ.get(FOLDERS, "").split(os.pathsep)))]
    allowed = [Path(os.path.realpath(folder)) for folder in folders]

    def require(key: str, file: str) -> None:
        real = Path(os.path.realpath(file))
        if not any(real.is_relative_to(folder) for folder in allowed):
            raise ImageError(
                f"{path}: {key}={file}: lies outside the document's folder{f' ({real})' if str(real) != file else ''}:"
                f" expected a file in it, or in a folder that ${FOLDERS} lists"
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
