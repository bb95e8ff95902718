# SPDX-License-Identifier: Apache-2.0
"""The recipe of a library: how materials are found, made, delivered and judged."""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Annotated, Any, Literal

from oiiotex.engine.errors import Error, ParameterError

from ..api.files import Allowed, Limit, checked_name, read_as
from ..materials.naming import COLORS, ROLES

_MOST_BYTES = 4 << 20
_NAME = re.compile(r"[a-z][a-z0-9_]*", re.ASCII)


def _require_among(what: str, value: str, allowed: tuple[str, ...]) -> None:
    if value not in allowed:
        names = ", ".join(name or '""' for name in allowed)
        raise ParameterError(f"{what} '{value}': expected {names}")


@dataclass(frozen=True, kw_only=True)
class MaterialFacts:
    """Facts about a material; '' and () if unknown."""

    license: str = ""
    author: str = ""
    tags: tuple[str, ...] = ()
    size_m: tuple[float, ...] = ()  # width and height in meters
    height_m: float = 0.0  # distance between heights 0 and 1 in meters; 0: unknown
    normals: Literal["", "opengl", "directx"] = ""  # convention of its normal map
    maps: Mapping[str, str] = field(default_factory=dict)  # files by role, below the photos, or ARCHIVE.zip!MEMBER
    skip: bool = False  # whether to ignore it

    def __post_init__(self) -> None:
        for role in self.maps:
            _require_among("maps", role, tuple(ROLES))
        if self.size_m and (len(self.size_m) != 2 or min(self.size_m) <= 0):
            raise ParameterError(f"size_m={list(self.size_m)}: expected width and height in meters, both > 0")
        if not 0 <= self.height_m < math.inf:
            raise ParameterError(f"height_m={self.height_m}: expected meters, >= 0")

    def under(self, own: MaterialFacts) -> MaterialFacts:
        """These facts, overridden by those of `own`; tags are combined."""
        values = {f.name: getattr(own, f.name) or getattr(self, f.name) for f in fields(MaterialFacts)}
        return MaterialFacts(**{**values, "tags": tuple(dict.fromkeys((*self.tags, *own.tags)))})


@dataclass(frozen=True, kw_only=True)
class Find(MaterialFacts):
    """How materials are found, and facts about all of them."""

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
    """A product: a line that is run for each material."""

    name: str
    line: str

    def __post_init__(self) -> None:
        taken = ("source", "tx", "hex", *ROLES)
        if not _NAME.fullmatch(self.name) or self.name in taken:
            raise ParameterError(f"name '{self.name}': expected a-z, 0-9 and _, but not {', '.join(taken)}")


@dataclass(frozen=True, kw_only=True)
class Deliver:
    """Files of an asset in addition to those that lines write."""

    format: Literal["exr", "tiff"] = "exr"
    color: str = "lin_rec709_scene"
    normals: Literal["opengl", ""] = "opengl"
    tx: bool = True
    shape: Literal["sphere", "plane"] = "sphere"
    materialx: bool = True
    usd: bool = False
    wang: bool = False
    hex: bool = False
    shader: bool = False

    def __post_init__(self) -> None:
        if self.shader and (self.shape != "sphere" or not (self.materialx or self.wang)):
            raise ParameterError(
                'shader = true renders the MaterialX document: requires materialx = true, shape = "sphere"'
            )
        if self.hex and (self.wang or not self.materialx):
            raise ParameterError("hex = true requires materialx = true, wang = false")
        if self.wang and self.format != "exr":
            raise ParameterError('wang = true requires format = "exr": TIFF files lose the number of tiles')


@dataclass(frozen=True, kw_only=True)
class _Judge:
    """Limits that send an asset to review."""

    limits: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for text in self.limits:
            Limit.read(text, "limits")


@dataclass(frozen=True, kw_only=True)
class _RecipeDocument:
    """The document of a recipe."""

    schema: Annotated[Literal[1], Allowed(words="(the version of the format)")]
    find: Find = Find()
    roles: dict[str, Role] = field(default_factory=dict)
    product: tuple[Product, ...] = ()
    deliver: Deliver = Deliver()
    judge: _Judge = _Judge()
    assets: dict[str, MaterialFacts] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class LibraryRecipe:
    """A checked recipe."""

    products: tuple[Product, ...]
    find: Find = Find()
    roles: Mapping[str, Role] = field(default_factory=dict)
    deliver: Deliver = Deliver()
    limits: tuple[Limit, ...] = ()
    assets: Mapping[str, MaterialFacts] = field(default_factory=dict)

    def space(self, role: str, floats: bool) -> str:
        """The color space of a role's files; '': as tagged in the file."""
        said = self.roles.get(role, Role())
        own = said.space_float if floats else said.space
        if own is not None:
            return own
        return ("lin_rec709_scene" if floats else "srgb_rec709_scene") if role in COLORS else "data"

    @property
    def words(self) -> dict[str, tuple[str, ...]]:
        """Additional words that denote a role."""
        return {role: said.words for role, said in self.roles.items()}


def commented_recipe() -> str:
    """An example recipe with all keys, commented."""
    return (Path(__file__).parent / "recipe.toml").read_text()


def load_recipe(path: Path) -> LibraryRecipe:
    """Read a recipe.

    Raises
    ------
    Error
        The file cannot be read, or its content is invalid.
    """
    return recipe_of(read_toml(path), str(path))


def recipe_of(document: Mapping[str, Any], name: str) -> LibraryRecipe:
    """Check a document and return its recipe; `name` is for messages."""
    said: _RecipeDocument = read_as(_RecipeDocument, document, name, ParameterError)
    for role in said.roles:
        _require_among(f"{name}: roles", role, tuple(ROLES))
    for asset in said.assets:
        checked_name(asset, f"{name}: assets:")
    if not said.product:
        raise ParameterError(f"{name}: no [[product]]: expected at least one")
    names = [product.name for product in said.product]
    if len(set(names)) < len(names):
        raise ParameterError(f"{name}: product names must be unique")
    return LibraryRecipe(
        find=said.find, roles=said.roles, products=said.product, deliver=said.deliver, assets=said.assets,
        limits=tuple(Limit.read(text, "limits") for text in said.judge.limits),
    )  # fmt: skip


def facts_beside(path: Path) -> MaterialFacts:
    """The facts in a NAME.toml next to a material."""
    facts: MaterialFacts = read_as(MaterialFacts, read_toml(path), str(path), ParameterError)
    return facts


def read_toml(path: Path) -> dict[str, Any]:
    """Read a TOML file of at most 4 MB.

    Raises
    ------
    Error
        The file is not TOML, too large, or not a regular file.
    """
    try:
        if not path.is_file():
            raise Error(f"{path}: no such file")
        if path.stat().st_size > _MOST_BYTES:
            raise Error(f"{path}: file too large: expected at most {_MOST_BYTES >> 20} MB")
        return tomllib.loads(path.read_text())
    except (OSError, UnicodeDecodeError) as error:
        raise Error(f"{path}: {getattr(error, 'strerror', None) or 'not text in UTF-8'}") from error
    except ValueError as error:  # also of an integer with more than 4,300 digits
        raise Error(f"{path}: {error}") from error
    except RecursionError as error:
        raise Error(f"{path}: nested too deeply") from error
