# SPDX-License-Identifier: Apache-2.0
"""Immutable settings of a run."""

from __future__ import annotations

from dataclasses import dataclass, field

from ..machine import memory


@dataclass(frozen=True, kw_only=True)
class Settings:
    """Settings of a run.

    Attributes
    ----------
    device_name : str or None
        As in `device.choose`.
    threads : int
        CPU threads; 0: as many as the process may use.
    budget : int
        Memory budget of an op, in bytes. Default: a quarter of the memory that the process may use.
    colorconfig : str or None
        An OCIO config; None: $OCIO, or the built-in one.
    interchange : (str, str) or None
        A color space of a config without interchange roles, and its equivalent of ours.
    autocc : bool
        Whether the config's file rules determine the color space of untagged files.
    all_parts : bool
        Whether ops of the host process all parts of an image instead of the first.
    profile : bool
        Whether to time every kernel.
    words : tuple of str
        The command line, for the metadata of written files.
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
