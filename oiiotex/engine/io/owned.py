# SPDX-License-Identifier: Apache-2.0
"""Names from documents, which must not be paths, and folders: only those that a run owns are removed or copied."""

from __future__ import annotations

import os
import shutil
from pathlib import Path, PureWindowsPath

from ..errors import Error, ParameterError

_MOST = 200  # bytes of a name: file systems allow 255, and files of the program add prefixes and suffixes


def checked_name(text: str, what: str) -> str:
    """Check that a name from a document, a catalog, an archive or a page can be the name of a file or folder.

    Parameters
    ----------
    text : str
        The name. Spaces, dots inside, and all languages are accepted.
    what : str
        What has the name, for the message.

    Returns
    -------
    str
        The name, unchanged.

    Raises
    ------
    ParameterError
        The name is empty, longer than 200 bytes, not printable, or a path on any system, or it starts or ends with a
        dot or a space.
    """
    plain = text.isprintable() and len(text.encode(errors="replace")) <= _MOST
    if not text or not plain or text.strip(" .") != text or PureWindowsPath(text).name != text:
        expected = f"expected a printable name of at most {_MOST} bytes, without / and \\, no . or space at its ends"
        raise ParameterError(f"{what} '{text[:60]}': {expected}")
    return text


def owned(path: Path, owner: Path) -> Path:
    """Check that a path lies inside a folder, that no link leads elsewhere, and that it is not a pipe or a device.

    It need not exist.

    Parameters
    ----------
    path : Path
        A path that begins with `owner`.
    owner : Path
        A folder, which may itself be a link.

    Returns
    -------
    Path
        The path, unchanged.

    Raises
    ------
    Error
        The path is the folder itself or outside of it, it has a symbolic link below the folder, or it is a pipe or a
        device, which would be waited for.
    """
    try:
        below = path.absolute().relative_to(owner.absolute())
        real, expected = os.path.realpath(path), os.path.join(os.path.realpath(owner), below)
    except ValueError:  # not below, or a NUL in the name
        raise Error(f"{path} is outside of {owner}") from None
    if not below.parts or ".." in below.parts:
        raise Error(f"{path} is outside of {owner}")
    if os.path.normcase(real) != os.path.normcase(expected):
        raise Error(f"{path} is a link, or below one: expected a file or folder of {owner}; remove the link")
    if os.path.exists(path) and not (os.path.isfile(path) or os.path.isdir(path)):
        raise Error(f"{path} is a pipe or a device: expected a file or folder; remove it")
    return path


def remove_folder(path: Path, owner: Path) -> None:
    """Remove a folder and everything in it, as far as possible. Links in it are removed, not followed.

    Raises
    ------
    Error
        As by `owned`; nothing is removed.
    """
    shutil.rmtree(owned(path, owner), ignore_errors=True)


def copy_folder(source: Path, owner: Path, target: Path) -> None:
    """Copy a folder to a path that does not exist.

    Raises
    ------
    Error
        As by `owned`, or the folder has a link or a device in it; nothing is copied.
    OSError
        A file cannot be read or written.
    """
    owned(source, owner)
    for folder, folders, files in os.walk(source):
        for name in (*folders, *files):
            path = Path(folder, name)
            if path.is_symlink() or not (path.is_file() or path.is_dir()):
                raise Error(f"{path} is a link or a device: expected files and folders; remove it")
    shutil.copytree(source, target, symlinks=True)
