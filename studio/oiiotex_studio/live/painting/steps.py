# SPDX-License-Identifier: Apache-2.0
"""A painting's history on disk. Steps are added, never removed. Each step is a painting with its plan."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

from oiiotex.engine.deferred import np

from ...api.files import written
from ..numbered import make_folder, next_number, taken
from .palette import COARSE, FINE
from .plans import regridded

_PAINTED = frozenset((".png", ".exr", ".tif", ".tiff"))
_MOST_OFFERED = 500


class Steps:
    """The steps of a painting: NNNNNN.png, NNNNNN.npz, and NNNNNN.fine.png if the fine layer is not empty.

    A step is made in `spare` and moved to `folder` by `save`, so a full disk loses no step. Steps that a killed process
    left in `spare` follow those of `folder`.
    """

    def __init__(self, folder: Path, spare: Path):
        self.folder, self._spare = folder, spare
        self._unsaved: set[int] = set()
        left = sorted(_whole(spare))
        saved = set(taken(folder).values())
        self._unsaved.update(left)
        if left and saved and left[0] <= max(saved):  # the folder has used these numbers meanwhile
            for step in left:
                self._rename(step, self.start())

    # --- paths ---

    def picture(self, step: int) -> Path:
        """The painting of a step."""
        return self._at(step) / f"{step:06d}.png"

    def fine(self, step: int) -> Path:
        """The fine layer of a step; the file is missing if the layer is empty."""
        return fine_of(self.picture(step))

    def plan(self, step: int) -> Path:
        """The plan of a step: the patches of its texture."""
        return self._at(step) / f"{step:06d}.npz"

    def layers(self, step: int) -> dict[str, Path]:
        """The files of a step's layers by name; the fine one can be missing."""
        return {COARSE: self.picture(step), FINE: self.fine(step)}

    def _at(self, step: int) -> Path:
        return self._spare if step in self._unsaved else self.folder

    def _files(self, step: int) -> tuple[Path, ...]:
        """All files of a step; the plan is last and completes the step."""
        return self.picture(step), self.fine(step), self.plan(step)

    # --- step numbers ---

    @property
    def numbers(self) -> list[int]:
        """All steps, ascending."""
        return sorted((_whole(self.folder) - self._unsaved) | (_whole(self._spare) & self._unsaved))

    @property
    def last(self) -> int:
        """The last step; -1 if there is none."""
        return max(self.numbers, default=-1)

    # --- new steps ---

    def start(self) -> int:
        """Reserve the number of a new step."""
        step = max(next_number(self.folder, 0), 1 + max(self._unsaved, default=-1))
        self._unsaved.add(step)
        return step

    def forget(self, step: int) -> None:
        """Discard a new step and its files."""
        for path in self._files(step) if step in self._unsaved else ():
            path.unlink(missing_ok=True)
        self._unsaved.discard(step)

    def join(self, looks: Sequence[int]) -> int:
        """Merge the previews of a stroke into one step: the last preview, with the number of the first."""
        *others, last = looks
        for look in others:
            self.forget(look)
        if others:
            self._unsaved.add(others[0])
            self._rename(last, others[0])
        return looks[0]

    def _rename(self, step: int, number: int) -> None:
        for path, other in zip(self._files(step), self._files(number), strict=True):
            if path.exists():
                path.replace(other)
        self._unsaved.discard(step)

    @property
    def unsaved(self) -> bool:
        """Whether a step is not saved to the folder yet."""
        return bool(self._unsaved & _whole(self._spare))

    def save(self) -> None:
        """Move unsaved steps to the folder."""
        if not self.unsaved:
            return
        for step in sorted(self._unsaved & _whole(self._spare)):
            made = [path for path in self._files(step) if path.exists()]
            make_folder(self.folder, "the steps of the painting")
            for path in made:
                with written(self.folder / path.name) as file:
                    file.write(path.read_bytes())
            self._unsaved.discard(step)
            for path in made:
                path.unlink()

    # --- plans ---

    def enlarged(self, step: int, times: int, budget: int) -> Path:
        """Write a plan for a painting `times` as large, next to the step's plan, by `plans.regridded`."""
        return self._written(self.plan(step).with_suffix(f".x{times}.npz"), regridded(self.plan(step), budget, times))

    def resized(self, step: int, size: tuple[int, int], budget: int) -> Path:
        """Write a plan of another size with the step's patches in place, as a start for the next step."""
        return self._written(self._spare / "resized.npz", regridded(self.plan(step), budget, size=size))

    def _written(self, path: Path, arrays: dict[str, np.ndarray]) -> Path:
        with written(path) as file:
            np.savez_compressed(file, **arrays)  # type: ignore[arg-type]  # mypy: a key could be 'allow_pickle'
        return path


def _whole(folder: Path) -> set[int]:
    """Steps with both a painting and a plan in a folder."""
    names = taken(folder)
    return {step for step in names.values() if {f"{step:06d}.png", f"{step:06d}.npz"} <= names.keys()}


def paintings_in(folders: Iterable[Path]) -> dict[str, Path]:
    """Image files of folders, the first _MOST_OFFERED by name, without symbolic links and fine layers (X.fine.png)."""
    entries = (entry for folder in dict.fromkeys(folders) if folder.is_dir() for entry in folder.iterdir())
    offered = sorted(
        entry
        for entry in entries
        if entry.suffix.lower() in _PAINTED and Path(entry.stem).suffix != ".fine"
        if entry.is_file() and not entry.is_symlink()
    )
    return {str(path): path for path in offered[:_MOST_OFFERED]}


def fine_of(path: Path) -> Path:
    """The path of a painting's fine layer."""
    return path.with_name(f"{path.stem}.fine{path.suffix}")
