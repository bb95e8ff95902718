# SPDX-License-Identifier: Apache-2.0
"""Small files that users hand over beside images: JSON, YAML, text, arrays. Nothing in them is trusted.

What is read is a regular file (a fifo would hang for ever) of a bounded size, numbers and texts of a document are such
that the rest of the program can take them, and arrays are refused by what they say of their size, before they are
unpacked.
"""

from __future__ import annotations

import json
import os
import stat
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from ..deferred import np
from ..errors import ImageError, one_line

_MOST_BYTES = 16 << 20  # of a document
_MOST_NUMBER = 2**53  # what a float64, and so any reader of JSON, holds exactly


def require_regular(path: str | os.PathLike[str]) -> None:
    """Refuse what is there but no regular file: opening a fifo waits for who writes to it.

    Raises
    ------
    ImageError
    """
    try:
        mode = os.stat(path).st_mode
    except (OSError, ValueError):
        return  # whoever opens it says why it cannot
    if not stat.S_ISREG(mode):
        raise ImageError(f"{path}: {'a folder' if stat.S_ISDIR(mode) else 'not a regular file'}")


def read_text(path: Path) -> str:
    """The text of a document."""
    require_regular(path)
    try:
        with open(path, "rb") as file:
            content = file.read(_MOST_BYTES + 1)
        if len(content) > _MOST_BYTES:
            raise ImageError(f"{path}: larger than {_MOST_BYTES >> 20} MB")
        return content.decode()
    except (OSError, UnicodeDecodeError) as error:
        raise ImageError(f"{path}: {getattr(error, 'strerror', None) or 'not text in UTF-8'}") from error


def read_document(path: Path) -> Any:
    """What a JSON file says, or a YAML file by its suffix.

    Raises
    ------
    ImageError
        As `read_text`; it is neither JSON nor YAML; a number is NaN, infinite or beyond 2^53; a text holds half of a
        surrogate pair.
    """
    text = read_text(path)
    yaml_file = path.suffix.lower() in (".yaml", ".yml")
    try:
        document = _yaml(text, path) if yaml_file else json.loads(text)
        require_plain(document)
    except RecursionError as error:
        raise ImageError(f"{path}: lists or objects lie too deep in each other") from error
    except ValueError as error:
        raise ImageError(f"{path}: not {'YAML' if yaml_file else 'JSON'}: {one_line(str(error))[:300]}") from error
    return document


def _yaml(text: str, path: Path) -> Any:
    try:
        import yaml  # ours needs no such package: JSON says the same
    except ImportError as error:
        raise ImageError(f"{path}: PyYAML is not installed: pip install pyyaml, or write it as JSON") from error
    if "&" in text and any(isinstance(event, yaml.AliasEvent) for event in _events(yaml, text)):
        raise ValueError("aliases are not taken: a few lines of them can stand for gigabytes")
    try:
        return yaml.safe_load(text)
    except yaml.YAMLError as error:
        raise ValueError(one_line(str(error))[:300]) from error


def _events(yaml: Any, text: str) -> Iterable[Any]:
    try:
        yield from yaml.parse(text, Loader=yaml.SafeLoader)
    except yaml.YAMLError as error:
        raise ValueError(one_line(str(error))[:300]) from error


def require_plain(document: Any) -> None:
    """Refuse, with ValueError, numbers and texts that the rest of the program could not take."""
    if isinstance(document, str):
        try:
            document.encode()
        except UnicodeEncodeError:
            raise ValueError(f"{ascii(document)[:60]} is no text: half of a surrogate pair") from None
    elif isinstance(document, (int, float)) and not -_MOST_NUMBER <= document <= _MOST_NUMBER:
        raise ValueError(f"{str(document)[:30]} is beyond 2^53")
    elif isinstance(document, dict):
        for name, value in document.items():
            require_plain(name)
            require_plain(value)
    elif isinstance(document, list):
        for value in document:
            require_plain(value)


def read_arrays(path: Path, budget: int) -> dict[str, np.ndarray]:
    """The arrays of an .npz file.

    Parameters
    ----------
    path : Path
    budget : int
        Bytes that all of them together may take in memory.

    Raises
    ------
    ImageError
        It cannot be read, or is larger than the budget; the text says how large.
    """
    import zipfile  # few lines read arrays: it is slow to import

    require_regular(path)
    try:
        with zipfile.ZipFile(path) as packed:
            need = sum(entry.file_size for entry in packed.infolist())
        if need > budget:
            raise ImageError(f"{path}: takes {-(-need >> 20)} MB of memory; the budget is {budget >> 20} MB")
        with np.load(path, allow_pickle=False) as arrays:
            return {name: arrays[name] for name in arrays.files}
    except ImageError:
        raise
    except Exception as error:  # of broken files zipfile, what unpacks for it, and numpy's parser of headers raise many
        why = getattr(error, "strerror", None) or one_line(str(error))[:300]
        raise ImageError(f"{path}: no arrays can be read: {why}") from error
