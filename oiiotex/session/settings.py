# SPDX-License-Identifier: Apache-2.0
"""What a run is asked to keep to. Nothing here is opened, and nothing changes: a change makes other settings."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TypedDict

from ..machine import memory


@dataclass(frozen=True, kw_only=True)
class Settings:
    """Settings of a run.

    Attributes
    ----------
    device_name : str or None
        As `device.choose` takes it.
    threads : int
        CPU threads; 0: as many as the process may use.
    budget : int
        Bytes of memory that one op may hold; a quarter of what the machine gives the process by default.
    colorconfig : str or None
        An OCIO config; None: $OCIO or a built-in one.
    interchange : (str, str) or None
        A space of a config that does not say how it meets others, and that of ours which is the same.
    autocc : bool
        Let the config's file rules name the space of an untagged file.
    all_parts : bool
        Ops of the host work on all parts of an image, not on the first alone.
    profile : bool
        Time every kernel.
    words : tuple of str
        The command line, for what files say of the program that wrote them.
    """

    device_name: str | None = None
    threads: int = 0
    budget: int = field(default_factory=lambda: memory() // 4)
    colorconfig: str | None = None
    interchange: tuple[str, str] | None = None
    autocc: bool = False
    all_parts: bool = False
    profile: bool = False
    words: tuple[str, ...] = ()


class Changes(TypedDict, total=False):
    """Keywords of `Settings`."""

    device_name: str | None
    threads: int
    budget: int
    colorconfig: str | None
    interchange: tuple[str, str] | None
    autocc: bool
    all_parts: bool
    profile: bool
    words: tuple[str, ...]
