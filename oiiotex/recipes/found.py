# SPDX-License-Identifier: Apache-2.0
"""Materials in a folder of photos: files and members of archives by their names, what is ambiguous as questions."""

from __future__ import annotations

import os
import re
import shutil
import stat
import struct
import zipfile
import zlib
from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath

from ..api.lines import nearest
from ..api.materials import PACKED, PACKED_ROLES, Name, read_name
from ..errors import Error, ParameterError
from .recipe import Facts, LibraryRecipe, facts_beside

LIBRARY = "library.sqlite"  # the file by which a library is known
_IMAGES = {".png", ".jpg", ".jpeg", ".tif", ".tiff", ".exr", ".hdr", ".webp", ".tga", ".bmp", ".psd", ".dpx"}
_FLOATS = {".exr", ".hdr"}
_MOST_MEMBER = 8 << 30  # bytes that a member of an archive may have
_LARGE = 64 << 20  # bytes from which on a member may not unpack to more than
_MOST_UNPACKED = 200  # times what it takes in the archive: zeros, which fill disks
_CHANNELS = "RGB"
# as zipfile fails on broken archives, which it says nothing of
_BROKEN_ARCHIVE = (
    OSError, ValueError, KeyError, IndexError, EOFError, RuntimeError, NotImplementedError, struct.error, zlib.error,
    zipfile.BadZipFile,
)  # fmt: skip


@dataclass(frozen=True)
class MapFile:
    """Where a map lies.

    Attributes
    ----------
    path : str
        Of the file, or of the archive that it is in; below the folder of photos, with slashes.
    member : str
        Its name in the archive.
    hand : str
        'opengl' or 'directx', of normals.
    channel : str
        The channel that it is; '': all.
    """

    path: str
    member: str = ""
    hand: str = ""
    channel: str = ""

    @property
    def suffix(self) -> str:
        """The extension, in lower case."""
        return PurePosixPath(self.member or self.path).suffix.lower()

    @property
    def floats(self) -> bool:
        """Whether its format holds floats."""
        return self.suffix in _FLOATS

    def __str__(self) -> str:
        return f"{self.path}!{self.member}" if self.member else self.path


@dataclass(frozen=True)
class Material:
    """Maps that belong together, what is known of them, and what has to be asked."""

    name: str
    maps: dict[str, MapFile]
    facts: Facts
    questions: tuple[str, ...] = ()


@dataclass(frozen=True)
class _Candidate:
    file: MapFile
    name: Name


def materials(photos: Path, recipe: LibraryRecipe) -> list[Material]:
    """All materials below a folder, by name.

    Raises
    ------
    Error
        The folder cannot be read, or the recipe speaks of what is not there.
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
        said, wrong = Facts(), broken.get(key, "")
        if key in beside:
            try:
                said = facts_beside(beside[key])
            except Error as error:
                wrong = str(error)
        facts = recipe.find.under(said).under(recipe.assets.get(names[key], Facts()))
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


def extract(photos: Path, file: MapFile, target: Path) -> None:
    """Put a map under a name, out of its archive where it is in one; what is then written there is not the photo.

    Raises
    ------
    Error
        The archive is broken, or the member is not there, too large, or packed as no photo is.
    """
    source = (photos / file.path).resolve()
    try:
        if not file.member:
            link_or_copy(source, target)
            return
        with zipfile.ZipFile(source) as archive:
            info = archive.getinfo(file.member)
            if info.file_size > _MOST_MEMBER:
                raise Error(f"{file}: larger than {_MOST_MEMBER >> 30} GB")
            if info.file_size > max(_LARGE, _MOST_UNPACKED * info.compress_size):
                raise Error(
                    f"{file}: unpacks to over {_MOST_UNPACKED} times its size: unpack the archive if you trust it"
                )
            with archive.open(file.member) as packed, open(target, "wb") as out:
                shutil.copyfileobj(packed, out, 1 << 20)
    except _BROKEN_ARCHIVE as error:
        raise Error(f"{file}: {error}") from error


def link_or_copy(source: Path, target: Path) -> None:
    """A file under a second name. Files are replaced by renaming, so either name may go its own way.

    A symbolic link would be followed instead, and the file that it leads to be replaced.
    """
    try:
        os.link(source, target)
    except OSError:  # another disk, or one that has no hard links
        shutil.copyfile(source, target)


def _files(photos: Path) -> Iterable[str]:
    """Files below the folder that matter, hidden ones left out; a link that leads nowhere is said where it is read."""
    if not photos.is_dir():
        raise Error(f"{photos}: no such folder")
    wanted = _IMAGES | {".zip", ".toml"}
    for folder, folders, names in os.walk(photos):
        if LIBRARY in names:  # a library is made of photos, and is none
            folders.clear()
            continue
        folders[:] = [name for name in folders if not name.startswith(".")]
        below = os.path.relpath(folder, photos).replace(os.sep, "/")
        for name in names:
            matters = not name.startswith(".") and os.path.splitext(name)[1].lower() in wanted
            if matters and _is_file(os.path.join(folder, name)):
                yield name if below == "." else f"{below}/{name}"


def _is_file(path: str) -> bool:
    """Whether it is no pipe, socket or device, which would be waited for."""
    try:
        return stat.S_ISREG(os.stat(path).st_mode)
    except OSError:  # it says why when it is read
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
    """Of which material a NAME.toml speaks; the one without a name, where it is called material.toml."""
    stem = PurePosixPath(path).stem
    return str(PurePosixPath(path).parent), "" if stem == "material" else read_name(stem, recipe.words).material


def _names(groups: Iterable[tuple[str, str]]) -> dict[tuple[str, str], str]:
    """A name for every group: the material's, with as many folders before it as tell it from others."""
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
    return re.sub(r"[^\w.-]+", "_", text).strip("._-") or "material"


def _material(name: str, candidates: list[_Candidate], facts: Facts, recipe: LibraryRecipe) -> Material:
    """The maps of a group, each role by one file, or a question."""
    questions = []
    maps: dict[str, MapFile] = {}
    by_role: dict[str, list[_Candidate]] = defaultdict(list)
    for candidate in candidates:
        by_role[candidate.name.role].append(candidate)
    nameless = by_role.pop("", [])
    if nameless and not by_role and len(nameless) == 1 and recipe.find.photos:
        maps["color"] = nameless[0].file
    elif nameless and not facts.maps:
        questions.append(f"what is {', '.join(str(c.file) for c in nameless)}? maps = {{ ROLE = FILE }} says it")
    for role, several in by_role.items():
        if role in facts.maps:
            continue
        chosen = _one(several, recipe.find.prefer)
        if len(chosen) > 1:
            files = ", ".join(str(c.file) for c in chosen)
            questions.append(f"which is its {role}: {files}? prefer = [WORD] or maps = {{ {role} = FILE }} says it")
        else:
            maps[role] = replace(chosen[0].file, hand=chosen[0].name.hand)
    for role, text in facts.maps.items():
        path, _, member = text.partition("!")
        maps[role] = MapFile(path, member)
    packed = maps.pop(PACKED, None)
    for channel, role in zip(_CHANNELS, PACKED_ROLES, strict=True):
        if packed is not None and role not in maps:
            maps[role] = replace(packed, channel=channel)
    if "normal" in maps:
        hand = maps["normal"].hand or facts.normals
        if not hand:
            questions.append('are its normals OpenGL\'s or DirectX\'? normals = "opengl" or "directx" says it')
        maps["normal"] = replace(maps["normal"], hand=hand)
    if "color" not in maps and not questions:
        questions.append("which is its color? maps = { color = FILE } says it, skip = true leaves it out")
    ordered = {role: maps[role] for role in sorted(maps, key=lambda role: (role != "color", role))}
    return Material(name, ordered, facts, tuple(questions))


def _one(several: list[_Candidate], prefer: tuple[str, ...]) -> list[_Candidate]:
    """The candidates that are left when those that are preferred are taken, word after word."""
    hands = {candidate.name.hand for candidate in several}
    if {"opengl", "directx"} <= hands:  # one surface, told twice
        several = [candidate for candidate in several if candidate.name.hand == "opengl"]
    for word in prefer:
        wanted = [c for c in several if word.lower() in (*c.name.marks, c.file.suffix[1:])]
        several = wanted or several
    return several
