# SPDX-License-Identifier: Apache-2.0
"""The recipe of a library: what is looked for, which lines make its products, what is delivered, what fails it."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Annotated, Any, Literal

from ..api.files import Allowed, Limit, read_as
from ..api.materials import COLORS, ROLES
from ..errors import Error, ParameterError

_MOST_BYTES = 4 << 20
_NAME = re.compile(r"[a-z][a-z0-9_]*", re.ASCII)


def _require_among(what: str, value: str, allowed: tuple[str, ...]) -> None:
    if value not in allowed:
        names = ", ".join(name or '""' for name in allowed)
        raise ParameterError(f"{what} '{value}': expected {names}")


@dataclass(frozen=True, kw_only=True)
class Facts:
    """What is known of a material; '' and () where nothing is."""

    license: str = ""
    author: str = ""
    tags: tuple[str, ...] = ()
    size_m: tuple[float, ...] = ()  # width and height in meters
    normals: Literal["", "opengl", "directx"] = ""  # what its map of normals is
    maps: Mapping[str, str] = field(default_factory=dict)  # by role: files below the photos, ARCHIVE.zip!MEMBER in one
    skip: bool = False  # it is left out

    def __post_init__(self) -> None:
        for role in self.maps:
            _require_among("maps", role, tuple(ROLES))
        if self.size_m and (len(self.size_m) != 2 or min(self.size_m) <= 0):
            raise ParameterError(f"size_m={list(self.size_m)}: expected width and height in meters")

    def under(self, own: Facts) -> Facts:
        """These, where `own` says nothing else; tags of both."""
        values = {f.name: getattr(own, f.name) or getattr(self, f.name) for f in fields(Facts)}
        return Facts(**{**values, "tags": tuple(dict.fromkeys((*self.tags, *own.tags)))})


@dataclass(frozen=True, kw_only=True)
class Find(Facts):
    """How materials are found, and what is known of all of them."""

    photos: bool = True
    prefer: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Role:
    """How a role's files are recognized and read."""

    words: tuple[str, ...] = ()
    space: str | None = None
    space_float: str | None = None


@dataclass(frozen=True, kw_only=True)
class Product:
    """What one line makes of a material."""

    name: str
    line: str

    def __post_init__(self) -> None:
        taken = ("source", "tx", *ROLES)
        if not _NAME.fullmatch(self.name) or self.name in taken:
            raise ParameterError(f"name '{self.name}': expected a-z, 0-9 and _, but not {', '.join(taken)}")


@dataclass(frozen=True, kw_only=True)
class Deliver:
    """What an asset holds beside what lines have made."""

    format: Literal["exr", "tiff"] = "exr"
    color: str = "lin_rec709_scene"
    normals: Literal["opengl", ""] = "opengl"
    tx: bool = True
    shape: Literal["sphere", "plane"] = "sphere"
    materialx: bool = True
    usd: bool = False


@dataclass(frozen=True, kw_only=True)
class _Judge:
    """What a result fails by."""

    limits: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for text in self.limits:
            Limit.read(text, "limits")


@dataclass(frozen=True, kw_only=True)
class _RecipeDocument:
    """A recipe as it is written."""

    schema: Annotated[Literal[1], Allowed(words="(what this version reads)")]
    find: Find = Find()
    roles: dict[str, Role] = field(default_factory=dict)
    product: tuple[Product, ...] = ()
    deliver: Deliver = Deliver()
    judge: _Judge = _Judge()
    assets: dict[str, Facts] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class LibraryRecipe:
    """A recipe, checked."""

    products: tuple[Product, ...]
    find: Find = Find()
    roles: Mapping[str, Role] = field(default_factory=dict)
    deliver: Deliver = Deliver()
    limits: tuple[Limit, ...] = ()
    assets: Mapping[str, Facts] = field(default_factory=dict)

    def space(self, role: str, floats: bool) -> str:
        """The color space of a role's files: '' as they say."""
        said = self.roles.get(role, Role())
        own = said.space_float if floats else said.space
        if own is not None:
            return own
        return ("lin_rec709_scene" if floats else "srgb_rec709_scene") if role in COLORS else "data"

    @property
    def words(self) -> dict[str, tuple[str, ...]]:
        """What else says a role."""
        return {role: said.words for role, said in self.roles.items()}


def commented_recipe() -> str:
    """A recipe with all that one may say, commented."""
    return (Path(__file__).parent / "recipe.toml").read_text()


def load_recipe(path: Path) -> LibraryRecipe:
    """Read a recipe.

    Raises
    ------
    Error
        It cannot be read, or something in it is not allowed.
    """
    return recipe_of(read_toml(path), str(path))


def recipe_of(document: Mapping[str, Any], name: str) -> LibraryRecipe:
    """The recipe that a document is; `name` is for messages."""
    said: _RecipeDocument = read_as(_RecipeDocument, document, name, ParameterError)
    for role in said.roles:
        _require_among(f"{name}: roles", role, tuple(ROLES))
    if not said.product:
        raise ParameterError(f"{name}: there is no [[product]]: nothing would be made")
    names = [product.name for product in said.product]
    if len(set(names)) < len(names):
        raise ParameterError(f"{name}: two products have one name")
    return LibraryRecipe(
        find=said.find, roles=said.roles, products=said.product, deliver=said.deliver, assets=said.assets,
        limits=tuple(Limit.read(text, "limits") for text in said.judge.limits),
    )  # fmt: skip


def facts_beside(path: Path) -> Facts:
    """What a NAME.toml beside a material says of it."""
    facts: Facts = read_as(Facts, read_toml(path), str(path), ParameterError)
    return facts


def read_toml(path: Path) -> dict[str, Any]:
    """A TOML file of bounded size.

    Raises
    ------
    Error
        It is none, too large, or no regular file.
    """
    try:
        if not path.is_file():
            raise Error(f"{path}: no such file")
        if path.stat().st_size > _MOST_BYTES:
            raise Error(f"{path}: larger than {_MOST_BYTES >> 20} MB")
        return tomllib.loads(path.read_text())
    except (OSError, UnicodeDecodeError) as error:
        raise Error(f"{path}: {error}") from error
    except tomllib.TOMLDecodeError as error:
        raise Error(f"{path}: {error}") from error
    except RecursionError as error:
        raise Error(f"{path}: nested too deeply") from error
