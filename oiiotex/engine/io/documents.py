# SPDX-License-Identifier: Apache-2.0
"""Small files from users: JSON, YAML, text, arrays. None of them is trusted.

Only regular files of limited size are read (a fifo would hang forever), numbers and strings of a document must be
usable by the rest of the program, and arrays are refused by their declared size before they are unpacked.
"""

from __future__ import annotations

import json
import os
import stat
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from ..deferred import np
from ..errors import ImageError, one_line, reason_of

_MOST_BYTES = 16 << 20  # per document
_MOST_NUMBER = 2**53  # exact in a float64, and so in any reader of JSON


def require_regular(path: str | os.PathLike[str], most: int | None = None) -> None:
    """Refuse an existing path that is not a regular file: opening a fifo waits for a writer. `most`: bytes.

    Raises
    ------
    ImageError
    """
    try:
        status = os.stat(path)
    except (OSError, ValueError):
        return  # opening it reports the error
    mode = status.st_mode
    if not stat.S_ISREG(mode):
        raise ImageError(f"{path}: {'a folder' if stat.S_ISDIR(mode) else 'not a regular file'}")
    if most is not None and status.st_size > most:
        raise ImageError(f"{path}: file too large: expected at most {most >> 20} MB")


def read_text(path: Path) -> str:
    """The text of a document."""
    require_regular(path)
    try:
        with open(path, "rb") as file:
            content = file.read(_MOST_BYTES + 1)
        if len(content) > _MOST_BYTES:
            raise ImageError(f"{path}: file too large: expected at most {_MOST_BYTES >> 20} MB")
        return content.decode()
    except (OSError, UnicodeDecodeError) as error:
        raise ImageError(f"{path}: {getattr(error, 'strerror', None) or 'not text in UTF-8'}") from error


def read_document(path: Path) -> Any:
    """The contents of a JSON file, or by its suffix a YAML file.

    Raises
    ------
    ImageError
        As `read_text`; invalid JSON or YAML; a number is NaN, infinite or beyond 2^53; a string holds an unpaired
        surrogate.
    """
    text = read_text(path)
    yaml_file = path.suffix.lower() in (".yaml", ".yml")
    try:
        document = _yaml(text, path) if yaml_file else json.loads(text)
        require_plain(document)
    except RecursionError as error:
        raise ImageError(f"{path}: lists or objects are nested too deeply") from error
    except ValueError as error:
        raise ImageError(f"{path}: not {'YAML' if yaml_file else 'JSON'}: {one_line(str(error))[:300]}") from error
    return document


def _yaml(text: str, path: Path) -> Any:
    try:
        import yaml  # optional: JSON can hold the same
    except ImportError as error:
        raise ImageError(f"{path}: PyYAML is not installed", hint="pip install pyyaml, or use JSON") from error
    if "&" in text and any(isinstance(event, yaml.AliasEvent) for event in _events(yaml, text)):
        raise ValueError("aliases are not supported: a few of them can expand to gigabytes")
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
    """Refuse, with ValueError, numbers and strings that the rest of the program cannot handle."""
    if isinstance(document, str):
        try:
            document.encode()
        except UnicodeEncodeError:
            raise ValueError(f"{ascii(document)[:60]} is not valid text: unpaired surrogate") from None
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
        Bytes that the arrays may take in memory, in total.

    Raises
    ------
    ImageError
        The file cannot be read, or its arrays exceed the budget.
    """
    import zipfile  # slow to import, and rarely needed

    require_regular(path)
    try:
        with zipfile.ZipFile(path) as packed:
            need = sum(entry.file_size for entry in packed.infolist())
        if need > budget:
            raise ImageError(f"{path}: needs {-(-need >> 20)} MB of memory; the budget is {budget >> 20} MB")
        with np.load(path, allow_pickle=False) as arrays:
            return {name: arrays[name] for name in arrays.files}
    except ImageError:
        raise
    except Exception as error:  # broken files raise many types in zipfile, its decompressors and numpy's header parser
        why = getattr(error, "strerror", None) or reason_of(error)[:300]
        raise ImageError(f"{path}: cannot read arrays: {why}") from error
