# SPDX-License-Identifier: Apache-2.0
"""Finds materials in a folder of photos by names of files and archive members; ambiguities become questions."""

from __future__ import annotations

import os
import re
import shutil
import stat
import struct
import zipfile
import zlib
from collections import defaultdict
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath

from oiiotex.engine.errors import Error, ParameterError

from ..api.files import checked_name
from ..api.images import Image
from ..api.lines import nearest
from ..api.materials import convention_of
from ..materials.naming import PACKED, PACKED_ROLES, Name, read_name
from .recipe import LibraryRecipe, MaterialFacts, facts_beside

LIBRARY = "library.sqlite"  # a folder with this file is a library
_IMAGES = {".png", ".jpg", ".jpeg", ".tif", ".tiff", ".exr", ".hdr", ".webp", ".tga", ".bmp", ".psd", ".dpx"}
_FLOATS = {".exr", ".hdr"}
_MOST_MEMBER = 8 << 30  # bytes; largest member of an archive
_LARGE = 64 << 20  # bytes; larger members must not exceed the compression ratio below
_MOST_UNPACKED = 200  # compression ratio of zip bombs
_MOST_NAME = 150  # bytes of a material's name: numbers and suffixes are added
_CHANNELS = "RGB"
# undocumented exceptions of zipfile for broken archives
_BROKEN_ARCHIVE = (
    OSError, ValueError, KeyError, IndexError, EOFError, RuntimeError, NotImplementedError, struct.error, zlib.error,
    zipfile.BadZipFile,
)  # fmt: skip


@dataclass(frozen=True)
class MapFile:
    """The location of a map.

    Attributes
    ----------
    path : str
        Path of the file or its archive, relative to the folder of photos, with slashes.
    member : str
        Name in the archive; '': a file.
    hand : str
        Convention of normals: 'opengl' or 'directx'; '': to be measured.
    channel : str
        The channel to use; '': all.
    """

    path: str
    member: str = ""
    hand: str = ""
    channel: str = ""

    @property
    def suffix(self) -> str:
        """The file extension in lower case."""
        return PurePosixPath(self.member or self.path).suffix.lower()

    @property
    def floats(self) -> bool:
        """Whether the file format stores floats."""
        return self.suffix in _FLOATS

    def __str__(self) -> str:
        return f"{self.path}!{self.member}" if self.member else self.path


@dataclass(frozen=True)
class Material:
    """Maps that belong together, with facts and open questions."""

    name: str
    maps: dict[str, MapFile]
    facts: MaterialFacts
    questions: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        checked_name(self.name, "material")


class Question(Error):
    """Only the recipe can decide; the material waits for it."""


@dataclass(frozen=True)
class _Candidate:
    file: MapFile
    name: Name


def materials(photos: Path, recipe: LibraryRecipe) -> list[Material]:
    """All materials below a folder, by name.

    Raises
    ------
    Error
        The folder cannot be read, or the recipe names missing materials or files.
    """
    groups: dict[tuple[str, str], list[_Candidate]] = defaultdict(list)
    beside: dict[tuple[str, str], Path] = {}
    broken: dict[tuple[str, str], str] = {}
    files = sorted(_files(photos))
    for path in files:
        if path.endswith(".toml"):
            beside[_key(path, recipe)] = photos / path
            continue
        try:
            images = _images(photos, path)
        except Error as error:
            images, inner = [], PurePosixPath(path).with_suffix("")
            groups[str(inner), ""], broken[str(inner), ""] = [], str(error)
        for file in images:
            inner = PurePosixPath(path).with_suffix("") / file.member if file.member else PurePosixPath(path)
            said_by_name = read_name(inner.stem, recipe.words)
            groups[str(inner.parent), said_by_name.material].append(_Candidate(file, said_by_name))
    names = _names(groups)
    found = {}
    for key, candidates in groups.items():
        said, wrong = MaterialFacts(), broken.get(key, "")
        if key in beside:
            try:
                said = facts_beside(beside[key])
            except Error as error:
                wrong = str(error)
        facts = recipe.find.under(said).under(recipe.assets.get(names[key], MaterialFacts()))
        if not facts.skip:
            material = _material(names[key], candidates, facts, recipe)
            found[names[key]] = replace(material, questions=(wrong,)) if wrong else material
    for name, facts in recipe.assets.items():
        if name in found or facts.skip:
            continue
        if not facts.maps:
            raise ParameterError(f"assets.{name}: no such material in {photos}{nearest(name, list(found))}")
        found[name] = _material(name, [], recipe.find.under(facts), recipe)
    there = set(files)
    for material in found.values():
        for file in material.maps.values():
            if file.path not in there:
                raise ParameterError(f"assets.{material.name}: {file}: no such file in {photos}")
    return [found[name] for name in sorted(found)]


def with_convention(material: Material, map_of: Callable[[str], Image]) -> tuple[Material, dict[str, float]]:
    """The material with the convention of its normals: that of the name or the recipe, or the measured one.

    Parameters
    ----------
    material : Material
    map_of : callable
        Reads the map of a role.

    Returns
    -------
    material : Material
    measures : dict
        `convention`: the correlation that has decided, positive for OpenGL. Empty if nothing was measured.

    Raises
    ------
    Question
        The map does not tell.
    """
    normal = material.maps.get("normal")
    if normal is None or normal.hand:
        return material, {}
    found = convention_of(map_of("normal"), map_of("height") if "height" in material.maps else None)
    if not found.hand:
        raise Question(
            f"which convention do the normals have? They do not tell (correlation {abs(found.ratio):.2f});"
            ' set normals = "opengl" or "directx"'
        )
    maps = {**material.maps, "normal": replace(normal, hand=found.hand)}
    return replace(material, maps=maps), {"convention": found.ratio}


def extract(photos: Path, file: MapFile, target: Path) -> None:
    """Link, copy or unpack a map to a path. Replacing the file there does not change the photo.

    Raises
    ------
    Error
        The archive is broken, or the member is missing, too large, or suspiciously compressed.
    """
    source = (photos / file.path).resolve()
    try:
        if not file.member:
            link_or_copy(source, target)
            return
        with zipfile.ZipFile(source) as archive:
            info = archive.getinfo(file.member)
            if info.file_size > _MOST_MEMBER:
                raise Error(f"{file}: file too large: expected at most {_MOST_MEMBER >> 30} GB")
            if info.file_size > max(_LARGE, _MOST_UNPACKED * info.compress_size):
                raise Error(
                    f"{file}: unpacks to over {_MOST_UNPACKED} times its size; if you trust the archive, unpack it"
                )
            with archive.open(file.member) as packed, open(target, "wb") as out:
                shutil.copyfileobj(packed, out, 1 << 20)
    except _BROKEN_ARCHIVE as error:
        raise Error(f"{file}: {error}") from error


def link_or_copy(source: Path, target: Path) -> None:
    """Make a hard link or a copy of a file. Files are replaced by renaming, which does not affect the other link.

    A symbolic link would not do: replacing it could replace its target.
    """
    try:
        os.link(source, target)
    except OSError:  # another disk, or no support for hard links
        shutil.copyfile(source, target)


def _files(photos: Path) -> Iterable[str]:
    """Relevant files below the folder, without hidden ones. Broken links are reported when they are read."""
    if not photos.is_dir():
        raise Error(f"{photos}: no such folder")
    wanted = _IMAGES | {".zip", ".toml"}
    for folder, folders, names in os.walk(photos):
        if LIBRARY in names:  # a library is not a source of photos
            folders.clear()
            continue
        folders[:] = [name for name in folders if not name.startswith(".")]
        below = os.path.relpath(folder, photos).replace(os.sep, "/")
        for name in names:
            matters = not name.startswith(".") and os.path.splitext(name)[1].lower() in wanted
            if matters and _is_file(os.path.join(folder, name)):
                yield name if below == "." else f"{below}/{name}"


def _is_file(path: str) -> bool:
    """Whether it is a regular file; reading a pipe, socket or device would block."""
    try:
        return stat.S_ISREG(os.stat(path).st_mode)
    except OSError:  # reported when it is read
        return True


def _images(photos: Path, path: str) -> list[MapFile]:
    if not path.lower().endswith(".zip"):
        return [MapFile(path)]
    try:
        with zipfile.ZipFile(photos / path) as archive:
            members = [info.filename for info in archive.infolist() if not info.is_dir()]
    except _BROKEN_ARCHIVE as error:
        raise Error(f"{path}: {error}") from error
    return [
        MapFile(path, member)
        for member in sorted(members)
        if PurePosixPath(member).suffix.lower() in _IMAGES and not PurePosixPath(member).name.startswith(".")
    ]


def _key(path: str, recipe: LibraryRecipe) -> tuple[str, str]:
    """The material that a NAME.toml describes; material.toml describes the unnamed one of its folder."""
    stem = PurePosixPath(path).stem
    return str(PurePosixPath(path).parent), "" if stem == "material" else read_name(stem, recipe.words).material


def _names(groups: Iterable[tuple[str, str]]) -> dict[tuple[str, str], str]:
    """A unique name for every group: the material's name, prefixed with as many folder names as needed."""
    parts = {key: [*PurePosixPath(key[0]).parts, *([key[1]] if key[1] else [])] or ["material"] for key in groups}
    names, length = {}, 1
    while parts:
        called: dict[str, list[tuple[str, str]]] = defaultdict(list)
        for key, words in parts.items():
            called[_safe("_".join(words[-length:]))].append(key)
        for name, keys in called.items():
            for number, key in enumerate(keys, 1):
                if len(keys) == 1 or length >= len(parts[key]):
                    names[key] = name if len(keys) == 1 else f"{name}_{number}"
        parts = {key: words for key, words in parts.items() if key not in names}
        length += 1
    return names


def _safe(text: str) -> str:
    plain = re.sub(r"[^\w.-]+", "_", text).strip("._-")
    return plain.encode()[:_MOST_NAME].decode(errors="ignore").strip("._-") or "material"


def _material(name: str, candidates: list[_Candidate], facts: MaterialFacts, recipe: LibraryRecipe) -> Material:
    """The material of a group: one file per role, or a question."""
    questions = []
    maps: dict[str, MapFile] = {}
    by_role: dict[str, list[_Candidate]] = defaultdict(list)
    for candidate in candidates:
        by_role[candidate.name.role].append(candidate)
    nameless = by_role.pop("", [])
    if nameless and not by_role and len(nameless) == 1 and recipe.find.photos:
        maps["color"] = nameless[0].file
    elif nameless and not facts.maps:
        questions.append(f"which role has {', '.join(str(c.file) for c in nameless)}? Set maps = {{ ROLE = FILE }}")
    for role, several in by_role.items():
        if role in facts.maps:
            continue
        chosen = _one(several, recipe.find.prefer)
        if len(chosen) > 1:
            files = ", ".join(str(c.file) for c in chosen)
            questions.append(f"which file is the {role}: {files}? Set prefer = [WORD] or maps = {{ {role} = FILE }}")
        else:
            maps[role] = replace(chosen[0].file, hand=chosen[0].name.hand)
    for role, text in facts.maps.items():
        path, _, member = text.partition("!")
        if member and PurePosixPath(member).suffix.lower() not in _IMAGES:
            raise ParameterError(f"assets.{name}: {text}: expected an image: {' '.join(sorted(_IMAGES))}")
        maps[role] = MapFile(path, member)
    packed = maps.pop(PACKED, None)
    for channel, role in zip(_CHANNELS, PACKED_ROLES, strict=True):
        if packed is not None and role not in maps:
            maps[role] = replace(packed, channel=channel)
    if "normal" in maps:
        maps["normal"] = replace(maps["normal"], hand=maps["normal"].hand or facts.normals)
    if "color" not in maps and not questions:
        questions.append("which file is the color? Set maps = { color = FILE }, or skip = true to ignore the material")
    ordered = {role: maps[role] for role in sorted(maps, key=lambda role: (role != "color", role))}
    return Material(name, ordered, facts, tuple(questions))


def _one(several: list[_Candidate], prefer: tuple[str, ...]) -> list[_Candidate]:
    """The candidates that remain after applying the preferred words in order."""
    hands = {candidate.name.hand for candidate in several}
    if {"opengl", "directx"} <= hands:  # the same surface in both conventions
        several = [candidate for candidate in several if candidate.name.hand == "opengl"]
    for word in prefer:
        wanted = [c for c in several if word.lower() in (*c.name.marks, c.file.suffix[1:])]
        several = wanted or several
    return several
