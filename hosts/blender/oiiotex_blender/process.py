# SPDX-License-Identifier: Apache-2.0
"""Client of the resident process for Blender's Python: jobs run in the background."""

from __future__ import annotations

import json
import os
import shutil
import socket
import subprocess
import threading

from .link.engine.errors import Error
from .link.oiiotool.service.messages import Link

_START = 60  # s; timeout for the start of the process
_PROGRAM = "import sys; from oiiotex.oiiotool.cli.main import main; sys.exit(main())"
_SET = "set Python in the extension's preferences to the one where oiiotex is installed"
CANCELED = "canceled"
CHANNELS = {1: ["Y"], 3: ["R", "G", "B"], 4: ["R", "G", "B", "A"]}


class Failed(Exception):
    """An error message of one line for the user."""


class Process:
    """The resident process of a Python with oiiotex, started on demand.

    Parameters
    ----------
    python : str
        Absolute path, or a name that is searched in the absolute folders of $PATH.

    Raises
    ------
    Failed
        It is not found.
    """

    def __init__(self, python: str):
        folders = [folder for folder in os.environ.get("PATH", "").split(os.pathsep) if os.path.isabs(folder)]
        self._python = python if os.path.isabs(python) else shutil.which(python, path=os.pathsep.join(folders))
        if self._python is None or not os.path.isabs(self._python):
            raise Failed(f"{python or 'Python'} is not in $PATH; {_SET}")

    def begin(self, op, maps, values, parts=None) -> Job:
        """Start an op.

        Parameters
        ----------
        op : str
        maps : list of (pixels, space)
            Input images: (height, width, channels) float32 or uint8, with a color space, or None for data.
        values : dict
            Modifiers of the op.
        parts : str, optional
            Prefix of the names of the parts to read. Default: the first part of each result.
        """
        return Job(self._connected, op, maps, values, parts)

    def run(self, words) -> Line:
        """Start the program with a command line."""
        return Line([self._python, "-I", "-c", _PROGRAM, *words])

    def _connected(self) -> socket.socket:
        line = [self._python, "-I", "-m", "oiiotex.oiiotool.service.door", '{"device": null}']
        try:
            done = subprocess.run(
                line, cwd="/", capture_output=True, text=True, timeout=_START, stdin=subprocess.DEVNULL
            )
            answer = json.loads(done.stdout)
        except (OSError, subprocess.TimeoutExpired) as error:
            raise Failed(f"{self._python} cannot be started; {_SET}") from error
        except ValueError as error:
            raise Failed(_sentence(self._python, done.stderr, done.returncode)) from error
        if "error" in answer:
            raise Failed(answer["error"])
        connection = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        connection.connect(answer["socket"])
        return connection


class Job:
    """A running op, on a separate thread that does not access Blender's data.

    Attributes
    ----------
    progress : float
        0 to 1.
    warnings : list of str
        Warnings about the result.
    """

    def __init__(self, connected, op, maps, values, parts):
        self.progress, self.warnings = 0.0, []
        self._results = self._error = self._link = None
        self._stopped = False
        self._thread = threading.Thread(target=self._run, args=(connected, op, maps, values, parts), daemon=True)
        self._thread.start()

    @property
    def done(self) -> bool:
        """Whether the job has ended, with or without a result."""
        return not self._thread.is_alive()

    def wait(self) -> None:
        """Wait for the end of the job."""
        self._thread.join()

    def cancel(self) -> None:
        """Disconnect, which cancels the job in the process."""
        self._stopped = True
        if self._link is not None:
            self._link.close()

    def result(self):
        """For each image, a list of (name of the part, pixels (height, width, channels)).

        Raises
        ------
        Failed
            The job has failed or was canceled.
        """
        if self._stopped:
            raise Failed(CANCELED)
        if self._error is not None:
            raise Failed(self._error)
        return self._results

    def _run(self, connected, op, maps, values, parts) -> None:
        try:
            self._link = Link(connected())
            if self._stopped:  # canceled before the connection existed
                return
            numbers = [
                self._ask({"do": "put", "image": _facts(pixels, space)}, [pixels])[0]["number"]
                for pixels, space in maps
            ]
            modifiers = {key: str(value) for key, value in values.items()}
            made = self._ask({"do": "make", "op": op, "images": numbers, "values": modifiers})[0]
            self.warnings = [text for level, text in made["log"] if level == "warning"]
            self._results = [
                [(name, self._ask({"do": "read", "image": image["number"], "part": name})[1][0]) for name in names]
                for image, names in ((image, _wanted(image, parts)) for image in made["images"])
            ]
        except (Failed, Error, OSError) as error:
            self._error = str(error)
        finally:
            if self._link is not None:
                self._link.close()

    def _ask(self, facts, arrays=()):
        self._link.send(facts | {"id": 1}, arrays)
        while True:
            answer, pixels = self._link.receive()
            if answer["state"] == "progress":
                self.progress = answer["done"] / max(1, answer["total"])
            elif answer["state"] == "done":
                return answer, pixels
            else:
                raise Failed(answer.get("text") or CANCELED)


class Line:
    """A run of the program, with the interface of `Job`."""

    progress, warnings = 0.0, ()

    def __init__(self, words):
        self._python, self._stopped = words[0], False
        try:
            self._program = subprocess.Popen(
                words, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
            )
        except OSError as error:
            raise Failed(f"{words[0]} cannot be started; {_SET}") from error

    @property
    def done(self) -> bool:
        """Whether the program has ended."""
        return self._program.poll() is not None

    def wait(self) -> None:
        """Wait for the end of the program."""
        self._program.wait()

    def cancel(self) -> None:
        """Terminate the program."""
        self._stopped = True
        self._program.terminate()

    def result(self) -> None:
        """Return None; raise Failed if the program has failed."""
        said = self._program.communicate()[1]
        if self._stopped:
            raise Failed(CANCELED)
        if self._program.returncode:
            raise Failed(_sentence(self._python, said, self._program.returncode))


def _sentence(python: str, said: str, code: int) -> str:
    """Why a program has failed: its error, the reason in words if it is another Python, or its exit code."""
    if "No module named 'oiiotex'" in said:
        return f"{python} has no oiiotex; {_SET}"
    lines = said.strip().splitlines() or [f"{python} cannot start oiiotex: exit code {code}"]
    return lines[-1]


def _wanted(image, parts) -> list[str]:
    names = [part["name"] for part in image["parts"]]
    return names[:1] if parts is None else [name for name in names if name.startswith(parts)]


def _facts(pixels, space):
    """The facts of an image, as in service/pictures.py."""
    height, width, count = pixels.shape
    place = [0, 0, width, height, 0, 0, width, height]
    kind = "uint8" if pixels.dtype.kind == "u" else "float"
    tags = [["oiio:ColorSpace", "string", space]] if space else []
    part = {
        "name": "image", "place": place, "type": kind, "channels": CHANNELS[count],
        "alpha": 3 if count == 4 else -1, "stored": kind, "exact": False, "attributes": tags,
    }  # fmt: skip
    return {"source": "image", "parts": [part]}
