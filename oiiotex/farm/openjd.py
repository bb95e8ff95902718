# SPDX-License-Identifier: Apache-2.0
"""Lines as Open Job Description templates (jobtemplate-2023-09), the standard that Deadline Cloud and others take.

A template is JSON, which is YAML as well. Its words run in the folder that its parameter says, with the program that
its other parameter says.
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from ..api.files import temporary_beside
from ..errors import ParameterError

_VERSION = "jobtemplate-2023-09"
_PLACE = re.compile(r"((?:.*/)?[^/,]+)(?:,([1-9][0-9]{0,4}))?", re.DOTALL)
_SHARES = 16  # when the line does not say
_IN_FOLDER = 'cd "$0" && exec "$@"'
_TIMEOUT = 86_400  # s that a task may take


def share_template(
    name: str, words: Sequence[str], shares: int, memory: int, program: str = "oiiotex"
) -> dict[str, Any]:
    """A line as so many shares of what it writes, and a step that puts them together.

    Parameters
    ----------
    name : str
        Of the job.
    words : sequence of str
        The line, without the program.
    shares : int
        >= 1.
    memory : int
        MB that a task needs.
    program : str
        What is run on workers, where the job does not say another.
    """
    _require_sayable(words)
    share = _step("Shares", [*words, "--share", f"{{{{Task.Param.Share}}}}/{shares}"], memory)
    share["parameterSpace"] = _numbers("Share", f"1-{shares}")
    join = _step("Join", [*words, "--join"], memory)
    join["dependencies"] = [{"dependsOn": "Shares"}]
    return _template(name, [share, join], program)


def frame_template(name: str, words: Sequence[str], frames: Sequence[int], memory: int) -> dict[str, Any]:
    """A line over a sequence as a task for each frame.

    Parameters
    ----------
    name : str
        Of the job.
    words : sequence of str
        The line with its wildcards, without the program and without `--frames`.
    frames : sequence of int
    memory : int
        MB that a task needs.
    """
    _require_sayable(words)
    step = _step("Frames", [*words, "--frames", "{{Task.Param.Frame}}"], memory)
    step["parameterSpace"] = _numbers("Frame", ",".join(map(str, frames)))
    return _template(name, [step], "oiiotex")


def place_of(text: str) -> tuple[Path, int]:
    """FILE or FILE,SHARES -> the file and how many shares.

    Raises
    ------
    ParameterError
        It is neither: what follows a comma is no number of shares.
    """
    match = _PLACE.fullmatch(text)
    if not match:
        raise ParameterError(
            f"--farm openjd={text}: expected openjd=FILE or openjd=FILE,SHARES, 1 to 99999, no comma in FILE"
        )
    return Path(match[1]), int(match[2] or _SHARES)


def write_template(path: Path, template: dict[str, Any], words: Iterable[str]) -> None:
    """Write a template, over an older one but over nothing else.

    Parameters
    ----------
    path : Path
    template : dict
    words : iterable of str
        Of the line: what it reads and writes is among them, or among their modifiers' values.

    Raises
    ------
    ParameterError
        The file is one of the line's, or there is one that is no template.
    ImageError
        It cannot be written.
    """
    target = os.path.realpath(path)
    for word in words:
        values = [word, *re.split("[:=]", word)] if word.startswith("-") else [word]
        if any(os.path.realpath(value) == target for value in values if value):
            raise ParameterError(
                f"--farm openjd={path}: the line reads or writes that file: give the template another name"
            )
    if os.path.lexists(path) and not _is_template(path):
        raise ParameterError(
            f"--farm openjd={path}: there is a file that is no job template of oiiotex: remove it first"
        )
    with temporary_beside(path) as temporary:
        temporary.write_text(json.dumps(template, indent=2) + "\n")


def _is_template(path: Path) -> bool:
    """Whether a file is what `write_template` writes."""
    if not path.is_file():  # reading a pipe would wait
        return False
    try:
        found = json.loads(path.read_bytes())
        names = [parameter["name"] for parameter in found["parameterDefinitions"]]
        return bool(found["specificationVersion"] == _VERSION and names == ["Folder", "Program"])
    except (OSError, ValueError, TypeError, KeyError):
        return False


def _require_sayable(words: Sequence[str]) -> None:
    """Templates have no way to say two braces."""
    for word in words:
        if "{{" in word:
            raise ParameterError(f"a job template: '{word}' has {{{{, which it cannot say")


def _step(name: str, line: Sequence[str], memory: int) -> dict[str, Any]:
    arguments = ["-c", _IN_FOLDER, "{{Param.Folder}}", "{{Param.Program}}", *line, "--openjd"]
    return {
        "name": name,
        "hostRequirements": {"amounts": [{"name": "amount.worker.memory", "min": memory}]},
        "script": {"actions": {"onRun": {"command": "sh", "args": arguments, "timeout": _TIMEOUT}}},
    }


def _numbers(name: str, range_of: str) -> dict[str, Any]:
    return {"taskParameterDefinitions": [{"name": name, "type": "INT", "range": range_of}]}


def _template(name: str, steps: list[dict[str, Any]], program: str) -> dict[str, Any]:
    return {
        "specificationVersion": _VERSION,
        "name": name,
        "parameterDefinitions": [
            {
                "name": "Folder",
                "type": "PATH",
                "objectType": "DIRECTORY",
                "dataFlow": "INOUT",
                "default": ".",
                "description": "where the line's names lie",
            },
            {"name": "Program", "type": "STRING", "default": program, "description": "the program on workers"},
        ],
        "steps": steps,
    }
