# SPDX-License-Identifier: Apache-2.0
"""Writes command lines as Open Job Description templates (jobtemplate-2023-09), for Deadline Cloud and others.

A template is JSON, which is valid YAML. The parameter Folder is the working folder, Program the executable.
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from oiiotex.engine.errors import Error, ParameterError

from ..api.files import read_document, temporary_beside

_VERSION = "jobtemplate-2023-09"
_PLACE = re.compile(r"((?:.*/)?[^/,]+)(?:,([1-9][0-9]{0,4}))?", re.DOTALL)
_SHARES = 16  # default
LEAST_MEMORY = 2048  # MB that a task requests, without --cache
_IN_FOLDER = 'cd "$0" && exec "$@"'
_TIMEOUT = 86_400  # s; time limit of a task


def share_template(
    name: str, words: Sequence[str], shares: int, memory: int, program: str = "oiiotex"
) -> dict[str, Any]:
    """A template that runs a line in shares of its output, followed by a step that joins them.

    Parameters
    ----------
    name : str
        Name of the job.
    words : sequence of str
        The line, without the program.
    shares : int
        Number of shares, >= 1.
    memory : int
        Memory requirement of a task in MB.
    program : str
        Default of the parameter Program.
    """
    _require_sayable(words)
    share = _step("Shares", [*words, "--share", f"{{{{Task.Param.Share}}}}/{shares}"], memory)
    share["parameterSpace"] = _numbers("Share", f"1-{shares}")
    join = _step("Join", [*words, "--join"], memory)
    join["dependencies"] = [{"dependsOn": "Shares"}]
    return _template(name, [share, join], program)


def frame_template(name: str, words: Sequence[str], frames: Sequence[int], memory: int) -> dict[str, Any]:
    """A template that runs a line for a sequence, with one task per frame.

    Parameters
    ----------
    name : str
        Name of the job.
    words : sequence of str
        The line with its wildcards, without the program and without `--frames`.
    frames : sequence of int
    memory : int
        Memory requirement of a task in MB.
    """
    _require_sayable(words)
    step = _step("Frames", [*words, "--frames", "{{Task.Param.Frame}}"], memory)
    step["parameterSpace"] = _numbers("Frame", ",".join(map(str, frames)))
    return _template(name, [step], "oiiotex")


def place_of(text: str) -> tuple[Path, int]:
    """Parse FILE or FILE,SHARES into the file and the number of shares.

    Raises
    ------
    ParameterError
        The number of shares is invalid.
    """
    match = _PLACE.fullmatch(text)
    if not match:
        raise ParameterError(
            f"--farm openjd={text}: expected openjd=FILE or openjd=FILE,SHARES (1 to 99999), without a comma in FILE"
        )
    return Path(match[1]), int(match[2] or _SHARES)


def write_template(path: Path, template: dict[str, Any], words: Iterable[str]) -> None:
    """Write a template. An existing template is replaced, other files are not.

    Parameters
    ----------
    path : Path
    template : dict
    words : iterable of str
        The line, including the names of the files that it reads and writes.

    Raises
    ------
    ParameterError
        The line uses the file, or it exists and is not a template.
    ImageError
        The file cannot be written.
    """
    target = os.path.realpath(path)
    for word in words:
        values = [word, *re.split("[:=]", word)] if word.startswith("-") else [word]
        if any(os.path.realpath(value) == target for value in values if value):
            raise ParameterError(
                f"--farm openjd={path}: the line reads or writes that file; choose another name for the template"
            )
    if os.path.lexists(path) and not _is_template(path):
        raise ParameterError(
            f"--farm openjd={path}: the file exists and is not a job template of oiiotex; remove it first"
        )
    with temporary_beside(path) as temporary:
        temporary.write_text(json.dumps(template, indent=2) + "\n")


def _is_template(path: Path) -> bool:
    """Whether a file is a template of `write_template`."""
    try:
        found = read_document(path)
        names = [parameter["name"] for parameter in found["parameterDefinitions"]]
        return bool(found["specificationVersion"] == _VERSION and names == ["Folder", "Program"])
    except (Error, TypeError, KeyError):
        return False


def _require_sayable(words: Sequence[str]) -> None:
    """Raise ParameterError for `{{`, which templates cannot escape."""
    for word in words:
        if "{{" in word:
            raise ParameterError(f"'{word}': a job template cannot contain {{{{")


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
                "description": "Working folder, to which file names are relative.",
            },
            {"name": "Program", "type": "STRING", "default": program, "description": "Executable on workers."},
        ],
        "steps": steps,
    }
