# SPDX-License-Identifier: Apache-2.0
"""Lines as Open Job Description templates (jobtemplate-2023-09), the standard that Deadline Cloud and others take.

A template is JSON, which is YAML as well. Its words run in the folder that its parameter says, with the program that
its other parameter says.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ..errors import ParameterError

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
        "specificationVersion": "jobtemplate-2023-09",
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
