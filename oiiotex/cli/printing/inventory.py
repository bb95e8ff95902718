# SPDX-License-Identifier: Apache-2.0
"""Options that print what there is: file formats, OpenImageIO's build, the colour config."""

from __future__ import annotations

import os
import sys
import textwrap
from collections.abc import Sequence

from ...deferred import oiio
from ..language.parse import Option
from ..stack.chain import Chain


def list_formats(chain: Chain) -> None:
    """Print the file formats and their extensions."""
    if not chain.acts():
        return
    print("All OIIO supported formats and their extensions:")
    for name, _, extensions in sorted(e.partition(":") for e in oiio.get_string_attribute("extension_list").split(";")):
        print(_wrapped(f"    {name} : {extensions.replace(',', ', ')}", 8, margin=2))


def build_info(chain: Chain) -> None:
    """Print what OpenImageIO was built from."""
    if not chain.acts():
        return
    say = oiio.get_string_attribute
    libraries = ", ".join(word.rpartition(":")[2] for word in say("build:dependencies").split(";"))
    print(_wrapped(f"OIIO {oiio.VERSION_STRING} | {say('build:platform')}", 4, margin=2))
    print(_wrapped(f"    Build compiler: {say('build:compiler')}", 4, margin=2))
    print(_wrapped(f"    HW features enabled at build: {say('build:simd') or 'no SIMD'}", 4, margin=2))
    cuda = oiio.get_int_attribute("cuda:build_version")
    if cuda:
        version = f"{cuda // 10000}.{cuda // 100 % 100}.{cuda % 100}"
        print(f"    CUDA {version} support enabled at build time")
    else:
        print("    No CUDA support (disabled / unavailable at build time)")
    if libraries:
        print(_wrapped(f"Dependencies: {libraries}", 4, margin=2))


def colour_config_info(chain: Chain) -> None:
    """Print what the colour config holds."""
    if not chain.acts():
        return
    config = oiio.ColorConfig(chain.session.resources.color.path)
    version = oiio.OpenColorIO_version_hex
    print(f"OpenColorIO {version >> 24}.{version >> 16 & 255}.{version >> 8 & 255}")
    print(f"Color config: {config.configname()}")
    print("Known color spaces: ")
    for name in config.getColorSpaceNames():
        print(f"    - {_quoted(name)}{_remarks(config, name)}")
        aliases = config.getAliases(name)
        if aliases:
            print(_wrapped(f"      aliases: {', '.join(map(_quoted, aliases))}", 6, margin=1))
    _print_list(
        "Known roles:", [f"{_quoted(r)} -> {_quoted(config.getColorSpaceNameByRole(r))}" for r in config.getRoles()]
    )
    _print_list("Known looks:", [_quoted(name) for name in config.getLookNames()])
    _print_list("Known displays: (* indicates default)", [_display(config, name) for name in config.getDisplayNames()])
    _print_list("Named transforms:", [_quoted(name) for name in config.getNamedTransformNames()])


def _remarks(config: oiio.ColorConfig, name: str) -> str:
    """Whether a space is linear: by itself, or because it is that of a role for linear ones."""
    roles = [(role, config.getColorSpaceNameByRole(role)) for role in ("scene_linear", "linear")]
    by_role = any(
        space and not config.equivalent(name, role) and config.equivalent(name, space) for role, space in roles
    )
    words = " (linear)" if by_role or config.isColorSpaceLinear(name) else ""
    return words if config.isColorSpaceActive(name) else f"{words} (inactive)"


def _display(config: oiio.ColorConfig, name: str) -> str:
    text = _quoted(name) + (" (*)" if name == config.getDefaultDisplayName() else "")
    default = config.getDefaultViewName(name)
    views = [_quoted(view) + (" (*)" if view == default else "") for view in config.getViewNames(name)]
    wrapped = _wrapped(f"views: {', '.join(views)}", 6, margin=1)
    return f"{text}\n      {wrapped}" if views else text


def _print_list(title: str, lines: Sequence[str]) -> None:
    if lines:
        print("\n".join([title, *(f"    - {line}" for line in lines)]))


def _quoted(name: str) -> str:
    return f'"{name}"' if " " in name else name


def _wrapped(text: str, indent: int, margin: int) -> str:
    """The text in lines that fit a terminal; as it is where there is none."""
    try:
        columns = os.get_terminal_size(sys.stdin.fileno()).columns - margin
    except (OSError, ValueError, AttributeError):
        return text
    if columns < indent + 20:
        return text
    return textwrap.fill(text, columns, subsequent_indent=" " * indent, break_on_hyphens=False, drop_whitespace=True)


OPTIONS = (
    Option("--list-formats", (), "print the file formats and their extensions", list_formats, state=True),
    Option("--buildinfo", (), "print what OpenImageIO was built from", build_info, state=True),
    Option("--colorconfiginfo", (), "print what the colour config holds", colour_config_info, state=True),
)
