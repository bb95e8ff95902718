# SPDX-License-Identifier: Apache-2.0
"""--cache-info and --cache-clear: the user's cache folder."""

from __future__ import annotations

import contextlib
from pathlib import Path

from ....engine.io.cache_folders import cache_folder

_KINDS = {
    "probe": "results of OpenCL device tests",
    "pocl": "kernels that PoCL has compiled",
    "programs": "programs for OpenCL runtimes without a cache",
    "linker": "linker for OpenCL runtimes that lack one",
    "candidates": "analyzed exemplars of --texsynth and --texzoom",
    "sigmas": "scales of --texsigmas and :evenness=",
}


def cache_info() -> str:
    """The cache folder, and the number, size and purpose of its entries."""
    folder = cache_folder()
    lines = [str(folder)]
    for kind, meaning in _KINDS.items():
        sizes = [path.stat().st_size for path in _files(folder, kind)]
        lines.append(f"  {kind:12s} {len(sizes):6d} files {sum(sizes) / 1e6:10.1f} MB  {meaning}")
    return "\n".join(lines)


def cache_clear() -> str:
    """Remove all entries, which later runs compute again; returns what was removed."""
    from ....engine.io.owned import remove_folder

    folder = cache_folder()
    files = [path for kind in _KINDS for path in _files(folder, kind)]
    size = sum(path.stat().st_size for path in files)
    for kind in _KINDS:
        for entry in folder.glob(f"{kind}*"):
            if entry.is_dir() and not entry.is_symlink():
                remove_folder(entry, folder)
            else:
                with contextlib.suppress(OSError):  # another process has removed it
                    entry.unlink()
    return f"{len(files)} files, {size / 1e6:.1f} MB removed from {folder}"


def _files(folder: Path, kind: str) -> list[Path]:
    """Regular files of a kind: those whose names start with it, or those of their folders."""
    tops = [top for top in folder.glob(f"{kind}*") if not top.is_symlink()]
    entries = [path for top in tops for path in (top, *top.rglob("*"))]
    return [path for path in entries if path.is_file() and not path.is_symlink()]
