# SPDX-License-Identifier: Apache-2.0
"""A painting's history on disk: steps are added and never taken away. Each is a painting, and its plan beside it."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Sequence
from pathlib import Path

from ..api.files import written
from ..api.painting import regridded
from ..deferred import np
from ..errors import ImageError
from .palette import COARSE, FINE

_TAKEN = re.compile(r"(\d{6})\..*")
_MOST_STEPS = 1_000_000
_PAINTED = frozenset((".png", ".exr", ".tif", ".tiff"))
_MOST_OFFERED = 500


class Steps:
    """The steps of a painting: files NNNNNN.png and .npz, and NNNNNN.fine.png where the fine layer has something.

    A step is made in `spare` and moved to `folder` by `save`: a full disk loses none. What a process that was killed
    left in `spare` belongs to the history, after the steps of `folder`.
    """

    def __init__(self, folder: Path, spare: Path):
        self.folder, self._spare = folder, spare
        self._unsaved: set[int] = set()
        left = sorted(_whole(spare))
        saved = self._taken(folder)
        self._unsaved.update(left)
        if left and saved and left[0] <= max(saved):  # numbers that the folder has meanwhile
            for step in left:
                self._rename(step, self.start())

    # --- where it is ---

    def picture(self, step: int) -> Path:
        """The painting after a step."""
        return self._at(step) / f"{step:06d}.png"

    def fine(self, step: int) -> Path:
        """Its fine layer, if there is anything in it."""
        return fine_of(self.picture(step))

    def plan(self, step: int) -> Path:
        """With which patches it was made."""
        return self._at(step) / f"{step:06d}.npz"

    def layers(self, step: int) -> dict[str, Path]:
        """Its layers by name, of which the fine one may not be there."""
        return {COARSE: self.picture(step), FINE: self.fine(step)}

    def _at(self, step: int) -> Path:
        return self._spare if step in self._unsaved else self.folder

    def _files(self, step: int) -> tuple[Path, ...]:
        """The plan last: it makes the step whole."""
        return self.picture(step), self.fine(step), self.plan(step)

    # --- which there are ---

    @property
    def numbers(self) -> list[int]:
        """All steps, in order."""
        return sorted((_whole(self.folder) - self._unsaved) | (_whole(self._spare) & self._unsaved))

    @property
    def last(self) -> int:
        """The last step; -1: none."""
        return max(self.numbers, default=-1)

    def _taken(self, folder: Path) -> set[int]:
        """Numbers that a file of the folder has, whosever it is."""
        names = os.listdir(folder) if _is_folder(folder) else []
        return {int(match[1]) for match in map(_TAKEN.fullmatch, names) if match}

    # --- more of them ---

    def start(self) -> int:
        """The number of a new step, whose files are to be made."""
        step = 1 + max(self._taken(self.folder) | self._unsaved, default=-1)
        if step >= _MOST_STEPS:
            raise ImageError(f"{self.folder}: has {_MOST_STEPS} steps: document=FILE begins another painting")
        self._unsaved.add(step)
        return step

    def copy_plan(self, step: int, to: int) -> None:
        """Give a step that was started the plan of another."""
        with written(self.plan(to)) as file:
            file.write(self.plan(step).read_bytes())

    def forget(self, step: int) -> None:
        """Take away the files of a step that was started and is not to be."""
        for path in self._files(step) if step in self._unsaved else ():
            path.unlink(missing_ok=True)
        self._unsaved.discard(step)

    def join(self, looks: Sequence[int]) -> int:
        """Make one step of the looks at a stroke: what the last shows, by the number of the first."""
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
        """Whether there is a step that is in memory alone."""
        return bool(self._unsaved & _whole(self._spare))

    def save(self) -> None:
        """Move what is in memory alone to the folder."""
        if not self.unsaved:
            return
        for step in sorted(self._unsaved & _whole(self._spare)):
            made = [path for path in self._files(step) if path.exists()]
            self._make_folder()
            for path in made:
                with written(self.folder / path.name) as file:
                    file.write(path.read_bytes())
            self._unsaved.discard(step)
            for path in made:
                path.unlink()

    def _make_folder(self) -> None:
        if os.path.lexists(self.folder) and not _is_folder(self.folder):
            raise ImageError(f"{self.folder}: is no folder, and steps of the painting go there: give it another name")
        try:
            self.folder.mkdir(exist_ok=True)
        except OSError as error:
            raise ImageError(f"{self.folder.absolute()}: {error.strerror}") from error

    # --- their plans ---

    def enlarged(self, step: int, times: int, budget: int) -> Path:
        """A plan of the painting so many times larger, beside the step's, as `painting.regridded` makes it."""
        return self._written(self.plan(step).with_suffix(f".x{times}.npz"), regridded(self.plan(step), budget, times))

    def resized(self, step: int, size: tuple[int, int], budget: int) -> Path:
        """A plan of another width and height with the step's patches where they are, to begin the next step with."""
        return self._written(self._spare / "resized.npz", regridded(self.plan(step), budget, size=size))

    def _written(self, path: Path, arrays: dict[str, np.ndarray]) -> Path:
        with written(path) as file:
            np.savez_compressed(file, **arrays)  # type: ignore[arg-type]  # to it a name could be allow_pickle
        return path


def _is_folder(path: Path) -> bool:
    """A link is no folder of ours: it may lead anywhere."""
    return path.is_dir() and not path.is_symlink()


def _whole(folder: Path) -> set[int]:
    """Steps of which a folder has picture and plan."""
    names = set(os.listdir(folder)) if _is_folder(folder) else set()
    steps = {int(match[1]) for match in map(_TAKEN.fullmatch, names) if match}
    return {step for step in steps if {f"{step:06d}.png", f"{step:06d}.npz"} <= names}


def paintings_in(folders: Iterable[Path]) -> dict[str, Path]:
    """Files of folders that may be paintings, the first _MOST_OFFERED by name; links are none.

    X.fine.png is the fine layer of X.png, and no painting of its own.
    """
    entries = (entry for folder in dict.fromkeys(folders) if folder.is_dir() for entry in folder.iterdir())
    offered = sorted(
        entry
        for entry in entries
        if entry.suffix.lower() in _PAINTED and Path(entry.stem).suffix != ".fine"
        if entry.is_file() and not entry.is_symlink()
    )
    return {str(path): path for path in offered[:_MOST_OFFERED]}


def fine_of(path: Path) -> Path:
    """Where the fine layer of a painting is, if it has one."""
    return path.with_name(f"{path.stem}.fine{path.suffix}")
