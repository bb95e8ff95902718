# SPDX-License-Identifier: Apache-2.0
"""The resident process of oiiotex, asked from Blender's Python: jobs that go on while Blender is used."""

from __future__ import annotations

import json
import os
import shutil
import socket
import subprocess
import threading

from .link.errors import Error
from .link.service.messages import Link

_START = 60  # s that the process may take until it listens
_PROGRAM = "import sys; from oiiotex.cli.main import main; sys.exit(main())"
CHANNELS = {1: ["Y"], 3: ["R", "G", "B"], 4: ["R", "G", "B", "A"]}


class Failed(Exception):
    """In one line, for who uses Blender."""


class Process:
    """That of a Python that has oiiotex, started where it does not run.

    Parameters
    ----------
    python : str
        A path, or a name that is looked for in the folders that $PATH names in full: not in the current one.

    Raises
    ------
    Failed
        There is none.
    """

    def __init__(self, python: str):
        folders = [folder for folder in os.environ.get("PATH", "").split(os.pathsep) if os.path.isabs(folder)]
        self._python = python if os.path.isabs(python) else shutil.which(python, path=os.pathsep.join(folders))
        if self._python is None or not os.path.isabs(self._python):
            raise Failed(f"{python} is not in $PATH: the extension's preferences say which Python")

    def begin(self, op, maps, values, parts=None) -> Job:
        """Begin an op.

        Parameters
        ----------
        op : str
        maps : list of (pixels, space)
            What it is made of: (height, width, channels) float32 or uint8, in a color space or None for data.
        values : dict
            Its modifiers.
        parts : str, optional
            How the names of those parts of the results begin that are wanted; their first ones when left out.
        """
        return Job(self._connected, op, maps, values, parts)

    def run(self, words) -> Line:
        """Begin a line of the program."""
        return Line([self._python, "-I", "-c", _PROGRAM, *words])

    def _connected(self) -> socket.socket:
        line = [self._python, "-I", "-m", "oiiotex.service.door", '{"device": null}']
        try:
            done = subprocess.run(
                line, cwd="/", capture_output=True, text=True, timeout=_START, stdin=subprocess.DEVNULL
            )
            answer = json.loads(done.stdout)
        except (OSError, subprocess.TimeoutExpired) as error:
            raise Failed(f"{self._python} cannot be started: the extension's preferences say which Python") from error
        except ValueError as error:
            said = done.stderr.strip().splitlines() or ["it says nothing"]
            raise Failed(f"{self._python} cannot start oiiotex: {said[-1]}") from error
        if "error" in answer:
            raise Failed(answer["error"])
        connection = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        connection.connect(answer["socket"])
        return connection


class Job:
    """An op that is under way, on a thread of its own. Blender's data is not touched there.

    Attributes
    ----------
    progress : float
        0 to 1.
    warnings : list of str
        What the user should know of the result.
    """

    def __init__(self, connected, op, maps, values, parts):
        self.progress, self.warnings = 0.0, []
        self._results = self._error = self._link = None
        self._stopped = False
        self._thread = threading.Thread(target=self._run, args=(connected, op, maps, values, parts), daemon=True)
        self._thread.start()

    @property
    def done(self) -> bool:
        """Whether there is a result, or none will come."""
        return not self._thread.is_alive()

    def wait(self) -> None:
        """Until it is done."""
        self._thread.join()

    def cancel(self) -> None:
        """Hang up: the process forgets the job."""
        self._stopped = True
        if self._link is not None:
            self._link.close()

    def result(self):
        """Names of parts and their pixels, (height, width, channels), image by image.

        Raises
        ------
        Failed
            There is none.
        """
        if self._stopped:
            raise Failed("canceled")
        if self._error is not None:
            raise Failed(self._error)
        return self._results

    def _run(self, connected, op, maps, values, parts) -> None:
        try:
            self._link = Link(connected())
            if self._stopped:  # before there was anything to hang up
                return
            numbers = [
                self._ask({"do": "put", "image": _facts(pixels, space)}, [pixels])[0]["number"]
                for pixels, space in maps
            ]
            texts = {key: str(value) for key, value in values.items()}
            made = self._ask({"do": "make", "op": op, "images": numbers, "values": texts})[0]
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
                raise Failed(answer.get("text") or "canceled")


class Line:
    """The program, with words of its own; to be waited for as a `Job` is."""

    progress, warnings = 0.0, ()

    def __init__(self, words):
        self._stopped = False
        try:
            self._program = subprocess.Popen(
                words, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
            )
        except OSError as error:
            raise Failed(f"{words[0]} cannot be started: the extension's preferences say which Python") from error

    @property
    def done(self) -> bool:
        """Whether it has ended."""
        return self._program.poll() is not None

    def wait(self) -> None:
        """Until it has ended."""
        self._program.wait()

    def cancel(self) -> None:
        """End it."""
        self._stopped = True
        self._program.terminate()

    def result(self) -> None:
        """Nothing; raises Failed where the program did."""
        said = self._program.communicate()[1].strip().splitlines()
        if self._stopped:
            raise Failed("canceled")
        if self._program.returncode:
            raise Failed(said[-1] if said else f"the program ended with {self._program.returncode}")


def _wanted(image, parts) -> list[str]:
    names = [part["name"] for part in image["parts"]]
    return names[:1] if parts is None else [name for name in names if name.startswith(parts)]


def _facts(pixels, space):
    """What service/pictures.py wants to know of an image."""
    height, width, count = pixels.shape
    place = [0, 0, width, height, 0, 0, width, height]
    kind = "uint8" if pixels.dtype.kind == "u" else "float"
    tags = [["oiio:ColorSpace", "string", space]] if space else []
    part = {
        "name": "image", "place": place, "type": kind, "channels": CHANNELS[count],
        "alpha": 3 if count == 4 else -1, "stored": kind, "exact": False, "attributes": tags,
    }  # fmt: skip
    return {"source": "image", "parts": [part]}
