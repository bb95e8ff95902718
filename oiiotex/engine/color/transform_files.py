# SPDX-License-Identifier: Apache-2.0
"""Files that OpenColorIO opens: a config, and the LUTs that it names. They are looked at before.

OpenColorIO waits for the writer of a fifo, reads a device until it is killed, and tries a dozen formats on a file of
any size. Meanwhile it holds Python's lock, so that no signal is handled.
"""

from __future__ import annotations

import contextlib
import copy
import os
import re
import zipfile
from collections.abc import Iterable, Iterator
from pathlib import Path

from ..deferred import ocio
from ..errors import ImageError
from ..io.documents import require_regular

_MOST_BYTES = 64 << 20  # of a LUT: a cube of 129 x 129 x 129 as text; it takes 3 s to load
_MOST_ARCHIVE = 512 << 20  # of all files in a config archive, unpacked
_MOST_DEPTH, _LONGEST_NAME = 32, 200  # of elements: OpenColorIO overflows its stack and its buffers beyond them
_REFERENCE = re.compile(rb"<Reference[^>]*\bpath\s*=\s*[\"']([^\"']+)")


def require_config(path: str) -> None:
    """Refuse a config, or an archive of one, that is not a regular file of limited size.

    Raises
    ------
    ImageError
    """
    require_regular(path, _MOST_ARCHIVE if path.endswith(".ocioz") else _MOST_BYTES)
    if not path.endswith(".ocioz"):
        return
    with contextlib.suppress(OSError, zipfile.BadZipFile), zipfile.ZipFile(path) as archive:  # OCIO reports these
        if sum(entry.file_size for entry in archive.infolist()) > _MOST_ARCHIVE:
            raise ImageError(f"{path}: its files take more than {_MOST_ARCHIVE >> 20} MB")


def require_files(config: ocio.Config, variables: dict[str, str], names: Iterable[str] = ()) -> None:
    """Refuse a config if a file of its transforms is not a regular file of limited size. Missing files are accepted.

    Parameters
    ----------
    config : OpenColorIO.Config
    variables : dict
        Context variables of an op, which may be part of a file name.
    names : iterable of str
        Further files, as an op names them.

    Raises
    ------
    ImageError
    """
    context = copy.deepcopy(config.getCurrentContext())
    for name, value in variables.items():
        context[name] = value
    for name in {*names, *_named_files(config)}:
        with contextlib.suppress(ocio.Exception, ocio.ExceptionMissingFile):  # OCIO reports it, if it is needed
            _require(context.resolveFileLocation(name), set())


def _require(path: str, seen: set[str]) -> None:
    """Refuse a file, or one that it refers to, as a CTF file can."""
    if path in seen:
        return
    seen.add(path)
    require_regular(path, _MOST_BYTES)
    if os.path.isfile(path):
        _require_plain_xml(path)
    if path.lower().endswith((".ctf", ".clf")) and os.path.isfile(path):
        for name in _REFERENCE.findall(Path(path).read_bytes()):
            _require(os.path.join(os.path.dirname(path), os.fsdecode(name)), seen)


def _named_files(config: ocio.Config) -> Iterator[str]:
    """File names in all transforms of a config, also of inactive spaces."""
    spaces = config.getColorSpaceNames(ocio.SEARCH_REFERENCE_SPACE_ALL, ocio.COLORSPACE_ALL)
    both = [config.getColorSpace(name) for name in spaces]
    both += [config.getViewTransform(name) for name in config.getViewTransformNames()]
    ways = (ocio.COLORSPACE_DIR_TO_REFERENCE, ocio.COLORSPACE_DIR_FROM_REFERENCE)
    views = (ocio.VIEWTRANSFORM_DIR_TO_REFERENCE, ocio.VIEWTRANSFORM_DIR_FROM_REFERENCE)
    for one in both:
        for way in views if isinstance(one, ocio.ViewTransform) else ways:
            yield from _files_of(one.getTransform(way))
    for name in config.getNamedTransformNames(ocio.NAMEDTRANSFORM_ALL):
        for direction in (ocio.TRANSFORM_DIR_FORWARD, ocio.TRANSFORM_DIR_INVERSE):
            yield from _files_of(config.getNamedTransform(name).getTransform(direction))
    for look in config.getLooks():
        yield from _files_of(look.getTransform())
        yield from _files_of(look.getInverseTransform())


def _files_of(transform: ocio.Transform | None) -> Iterator[str]:
    if isinstance(transform, ocio.GroupTransform):
        for one in transform:
            yield from _files_of(one)
    elif isinstance(transform, ocio.FileTransform):
        yield transform.getSrc()


def _require_plain_xml(path: str) -> None:
    """Refuse XML, of any suffix, that ends OpenColorIO with a segmentation fault: not well-formed, or deep."""
    from xml.parsers import expat

    depth = 0

    def begin(name: str, _: object) -> None:
        nonlocal depth
        depth += 1
        if depth > _MOST_DEPTH or len(name) > _LONGEST_NAME:
            limits = f"at most {_MOST_DEPTH} levels, with names of at most {_LONGEST_NAME} characters"
            raise ImageError(f"{path}: expected XML of {limits}")

    def end(_: str) -> None:
        nonlocal depth
        depth -= 1

    with open(path, "rb") as file:
        if not file.read(64).lstrip(b"\xef\xbb\xbf \t\r\n").startswith(b"<"):
            return
        file.seek(0)
        parser = expat.ParserCreate()
        parser.StartElementHandler, parser.EndElementHandler = begin, end
        try:
            parser.ParseFile(file)
        except expat.ExpatError as error:
            raise ImageError(f"{path}: not well-formed XML: {error}") from error
