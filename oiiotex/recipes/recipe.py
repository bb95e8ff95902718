# SPDX-License-Identifier: Apache-2.0
"""The recipe of a library: what is looked for, which lines make its products, what is delivered, what fails it."""

from __future__ import annotations

import operator
import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any, NamedTuple

from ..api.lines import nearest
from ..api.materials import COLOURS, ROLES
from ..errors import Error, ParameterError, within

SCHEMA = 1
_MOST_BYTES = 4 << 20
_NAME = re.compile(r"[a-z][a-z0-9_]*", re.ASCII)
_LIMIT = re.compile(r"([a-z_]+)\s*([<>])\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)", re.ASCII)
_BEYOND = {">": operator.gt, "<": operator.lt}
_HANDS = ("opengl", "directx")


def _require_among(what: str, value: str, allowed: tuple[str, ...]) -> None:
    if value not in allowed:
        names = ", ".join(name or '""' for name in allowed)
        raise ParameterError(f"{what} '{value}': expected {names}")


class Limit(NamedTuple):
    """A measure, and beyond what it fails."""

    measure: str
    relation: str
    value: float

    @classmethod
    def read(cls, text: str) -> Limit:
        """From 'NAME>NUMBER' or 'NAME<NUMBER'."""
        match = _LIMIT.fullmatch(text.strip())
        if not match:
            raise ParameterError(f"'{text}': expected NAME>NUMBER or NAME<NUMBER, such as seam>1.5")
        return cls(match[1], match[2], float(match[3]))

    def passed_by(self, value: float) -> bool:
        """Whether a value lies beyond it."""
        return bool(_BEYOND[self.relation](value, self.value))

    def __str__(self) -> str:
        return f"{self.measure}{self.relation}{self.value:g}"


@dataclass(frozen=True, kw_only=True)
class Facts:
    """What is known of a material; '' and () where nothing is.

    Attributes
    ----------
    licence, author : str
    tags : tuple of str
    size_m : tuple of float
        Width and height in metres.
    normals : str
        'opengl' or 'directx': what its map of normals is.
    maps : mapping of role to str
        Files below the folder of photos, 'ARCHIVE.zip!MEMBER' in an archive.
    skip : bool
        It is left out.
    """

    licence: str = ""
    author: str = ""
    tags: tuple[str, ...] = ()
    size_m: tuple[float, ...] = ()
    normals: str = ""
    maps: Mapping[str, str] = field(default_factory=dict)
    skip: bool = False

    def __post_init__(self) -> None:
        _require_among("normals", self.normals, ("", *_HANDS))
        for role in self.maps:
            _require_among("maps", role, tuple(ROLES))
        if self.size_m and (len(self.size_m) != 2 or min(self.size_m) <= 0):
            raise ParameterError(f"size_m={list(self.size_m)}: expected width and height in metres")

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
    """How a role's files are recognised and read."""

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

    format: str = "exr"
    colour: str = "lin_rec709_scene"
    normals: str = "opengl"
    tx: bool = True
    shape: str = "sphere"
    materialx: bool = True
    usd: bool = False

    def __post_init__(self) -> None:
        _require_among("format", self.format, ("exr", "tiff"))
        _require_among("normals", self.normals, ("opengl", ""))
        _require_among("shape", self.shape, ("sphere", "plane"))


@dataclass(frozen=True, kw_only=True)
class Recipe:
    """A recipe, checked."""

    products: tuple[Product, ...]
    find: Find = Find()
    roles: Mapping[str, Role] = field(default_factory=dict)
    deliver: Deliver = Deliver()
    limits: tuple[Limit, ...] = ()
    assets: Mapping[str, Facts] = field(default_factory=dict)

    def space(self, role: str, floats: bool) -> str:
        """The colour space of a role's files: '' as they say."""
        said = self.roles.get(role, Role())
        own = said.space_float if floats else said.space
        if own is not None:
            return own
        return ("lin_rec709_scene" if floats else "srgb_rec709_scene") if role in COLOURS else "data"

    @property
    def words(self) -> dict[str, tuple[str, ...]]:
        """What else says a role."""
        return {role: said.words for role, said in self.roles.items()}


def commented_recipe() -> str:
    """A recipe with all that one may say, commented."""
    return (Path(__file__).parent / "recipe.toml").read_text()


def load_recipe(path: Path) -> Recipe:
    """Read a recipe.

    Raises
    ------
    Error
        It cannot be read, or something in it is not allowed.
    """
    return recipe_of(read_toml(path), str(path))


def recipe_of(document: Mapping[str, Any], name: str) -> Recipe:
    """The recipe that a document is; `name` is for messages."""
    known = {"schema", "find", "roles", "product", "deliver", "judge", "assets"}
    _refuse_unknown(document, known, name)
    if document.get("schema") != SCHEMA:
        raise ParameterError(f"{name}: schema = {document.get('schema')}: this version reads schema = {SCHEMA}")
    judge = _table(document, "judge", name)
    _refuse_unknown(judge, {"limits"}, f"{name}: judge")
    tables = {key: _table(document, key, name) for key in ("roles", "assets")}
    for role in tables["roles"]:
        _require_among(f"{name}: roles", role, tuple(ROLES))
    products = document.get("product", [])
    if not isinstance(products, list) or not products:
        raise ParameterError(f"{name}: there is no [[product]]: nothing would be made")
    recipe = Recipe(
        find=_made(Find, _table(document, "find", name), f"{name}: find"),
        roles={role: _made(Role, table, f"{name}: roles.{role}") for role, table in tables["roles"].items()},
        products=tuple(_made(Product, table, f"{name}: product") for table in products),
        deliver=_made(Deliver, _table(document, "deliver", name), f"{name}: deliver"),
        limits=tuple(_limits(judge.get("limits", []), name)),
        assets={asset: _made(Facts, table, f"{name}: assets.{asset}") for asset, table in tables["assets"].items()},
    )
    names = [product.name for product in recipe.products]
    if len(set(names)) < len(names):
        raise ParameterError(f"{name}: two products have one name")
    return recipe


def facts_beside(path: Path) -> Facts:
    """What a NAME.toml beside a material says of it."""
    return _made(Facts, read_toml(path), str(path))


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


def _limits(texts: Any, name: str) -> list[Limit]:
    if not isinstance(texts, list) or not all(isinstance(text, str) for text in texts):
        raise ParameterError(f"{name}: judge.limits: expected a list of texts")
    with within(f"{name}: judge.limits"):
        return [Limit.read(text) for text in texts]


def _table(document: Mapping[str, Any], key: str, name: str) -> dict[str, Any]:
    table = document.get(key, {})
    if not isinstance(table, dict):
        raise ParameterError(f"{name}: {key}: expected a table")
    return table


def _refuse_unknown(table: Mapping[str, Any], known: set[str], where: str) -> None:
    for key in table:
        if key not in known:
            raise ParameterError(f"{where}: unknown key '{key}'{nearest(key, sorted(known))}")


def _made(kind: Any, table: Any, where: str) -> Any:
    """A dataclass of a table whose values have the types of its fields."""
    if not isinstance(table, dict):
        raise ParameterError(f"{where}: expected a table")
    declared = {f.name: str(f.type) for f in fields(kind)}
    _refuse_unknown(table, set(declared), where)
    values = {key: _typed(value, declared[key], f"{where}: {key}") for key, value in table.items()}
    missing = [f.name for f in fields(kind) if f.name in ("name", "line") and f.name not in values]
    if missing:
        raise ParameterError(f"{where}: {missing[0]} must be given")
    with within(where):
        return kind(**values)


def _typed(value: Any, kind: str, where: str) -> Any:
    if kind.startswith("tuple") and isinstance(value, list):
        item, label = ((int, float), "numbers") if "float" in kind else (str, "texts")
        if all(isinstance(v, item) and not isinstance(v, bool) for v in value):
            return tuple(value)
        raise ParameterError(f"{where}: expected a list of {label}")
    if kind.startswith("Mapping") and isinstance(value, dict) and all(isinstance(v, str) for v in value.values()):
        return value
    if (kind.startswith("str") and isinstance(value, str)) or (kind == "bool" and isinstance(value, bool)):
        return value
    expected = {"str": "a text", "bool": "true or false", "tuple": "a list", "Mapping": "a table of texts"}
    raise ParameterError(f"{where}: expected {expected[kind.split('[')[0].split(' ')[0]]}")
