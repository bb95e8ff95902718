# SPDX-License-Identifier: Apache-2.0
"""From images to hubs: maps of a material are found by their names, untagged photos get the color space of the page."""

from __future__ import annotations

import itertools
from collections import defaultdict
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from oiiotex.engine.errors import Error

from ...api.files import read_document
from ...api.images import TAG, Image, Session, read, tagged
from ...api.painting import read_graph
from ...api.service import reserved_folder
from ...materials.naming import COLORS, read_name
from ..display import usual_view, views
from ..document import LEAST_PAINTED, Document, default_state
from ..hub import Hub, MaterialMap, PageSource
from ..painting.room import PaintRoom
from ..tile_room import TileRoom
from ..zoom_room import ZoomRoom

_PAINTED = 1024  # px, maximum side of a new painting


@dataclass(frozen=True)
class OpenPhoto:
    """An image to open, with the command line up to it, and the other maps of its material."""

    image: Image
    words: tuple[str, ...]
    maps: tuple[MaterialMap, ...] = ()

    @property
    def path(self) -> Path:
        """The file, which identifies the photo."""
        return Path(self.image.source).resolve()


def materials_of(photos: Sequence[OpenPhoto]) -> list[OpenPhoto]:
    """Photos, of which those that are maps of one material by their names become one, with its color first."""
    groups: dict[tuple[Path, str], list[tuple[str, str, OpenPhoto]]] = defaultdict(list)
    for photo in photos:
        path = Path(photo.image.source)
        name = read_name(path.stem)
        groups[path.parent, name.material if name.role else str(photo.path)].append((name.role, name.hand, photo))
    opened = list[OpenPhoto]()
    for group in groups.values():
        roles = [role for role, *_ in group]
        if len(group) == 1 or "color" not in roles or len(set(roles)) < len(roles):
            opened += [photo for *_, photo in group]
            continue
        color = next(photo for role, _, photo in group if role == "color")
        maps = tuple(
            MaterialMap(role, _kind(role), hand, photo.image, photo.words[_shared(color.words, photo.words) :])
            for role, hand, photo in group
            if photo is not color
        )
        opened.append(replace(color, maps=maps))
    return opened


def require_memory(photo: OpenPhoto, session: Session) -> None:
    """Check that a photo fits the memory budget, before its pixels are read."""
    images = [photo.image, *(one.image for one in photo.maps)]
    need = sum(part.spec.image_bytes() for image in images for part in image.parts)
    session.resources.require(need, photo.path.name, "reduce or crop the photo")


def _shared(one: Sequence[str], other: Sequence[str]) -> int:
    """The number of words that two lines begin with: options that apply throughout."""
    return next(n for n, pair in enumerate(itertools.zip_longest(one, other)) if pair[0] != pair[1])


def _kind(role: str) -> str:
    return "color" if role in COLORS else role if role in ("normal", "height") else "data"


def hub_of(
    photo: OpenPhoto | None, session: Session, folder: Path, *, taken: Collection[Path] = (),
    words: tuple[str, ...] = (), graph: Path | None = None, document: Path | None = None, pixel_type: str = "",
) -> Hub:  # fmt: skip
    """The hub of a photo or a graph, with its document and its rooms.

    Parameters
    ----------
    photo : OpenPhoto or None
        None with `graph`.
    session : Session
    folder : Path
        Where documents are, and all files that a page writes.
    taken : collection of Path
        Documents that are open.
    words : tuple of str
        The command line of a graph.
    graph, document : Path, optional
        An exemplar graph; the document, by default NAME.texlive.json.
    pixel_type : str
        Of files that are made, as -d names it; '': that of the photo, float for a graph.

    Raises
    ------
    Error
        The photo does not fit the memory budget, or the document belongs to another photo or is already open.
    """
    color = session.resources.color
    if graph is not None:
        described = read_graph(graph)
        first, name = read(described.files[described.root], session.resources.cache), str(graph)
    else:
        assert photo is not None
        first, words, name = photo.image, photo.words, photo.image.source
        require_memory(photo, session)
    first = color.believed(first)
    tag = first.first.spec.get_string_attribute(TAG)
    space = color.resolve(tag) if tag else None
    stem = Path(name).stem
    sides = first.first.spec.width, first.first.spec.height
    side = min(256, 1 << min(sides).bit_length() - 1)
    state = default_state(*usual_view(color, space), side)
    state["paint"] |= dict(zip(("width", "height"), (min(max(n, LEAST_PAINTED), _PAINTED) for n in sides), strict=True))
    state["zoom"]["zoom"] = float(side.bit_length() - 1)
    path = document or _document(folder, stem, name, taken)
    spare = reserved_folder(path)
    opened = Document(path, state, name, views(color), spare / "document.json")
    pixel_type = pixel_type or ("float" if graph is not None else str(first.first.spec.format))
    asks = graph is None and space is None and not (session.settings.autocc and color.space_by_file_rules(name))
    source = PageSource(
        None if photo is None else first, "" if graph is None else str(graph), words, stem, space, side, pixel_type,
        () if photo is None else photo.maps, asks,
    )  # fmt: skip
    hub = Hub(source, opened, session, spare)
    hub.rooms = {"tile": TileRoom(hub), "paint": PaintRoom(hub), "zoom": ZoomRoom(hub)}
    if asks and opened.state["photo"]["space"]:
        tag_photo(hub, opened.state["photo"]["space"])
    return hub


def tag_photo(hub: Hub, name: str) -> None:
    """Give an untagged photo a color space, as --iscolorspace does on the line. Its document keeps it.

    Raises
    ------
    ColorError
        The config has no such color space.
    """
    source, color = hub.source, hub.session.resources.color
    assert source.image is not None
    space = color.resolve(name)
    image, words = tagged(source.image, space), (*source.words, "--iscolorspace", name)
    hub.source = replace(source, image=image, words=words, space=space, asks=False)
    hub.document.change("photo", {"space": name})
    hub.document.change("view", dict(zip(("display", "view"), usual_view(color, space), strict=True)))


def _document(folder: Path, stem: str, source: str, taken: Collection[Path]) -> Path:
    """The document of a photo: the first of NAME.texlive.json, NAME_2.texlive.json ... that belongs to no other."""
    numbered = (folder / f"{stem}_{n}.texlive.json" for n in itertools.count(2))
    return next(
        path
        for path in itertools.chain((folder / f"{stem}.texlive.json",), numbered)
        if path not in taken and _source(path) in ("", source)
    )


def _source(path: Path) -> str:
    """The photo that an existing document belongs to; '' if it cannot be told."""
    try:
        content = read_document(path) if path.exists() else None
    except Error:  # said when the document is opened
        content = None
    return str(content.get("source", "")) if isinstance(content, dict) else ""
