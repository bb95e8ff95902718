# SPDX-License-Identifier: Apache-2.0
"""A process that runs the jobs of `parallel.Workers`: `oiiotex.oiiotool.cli.running.worker LEVEL DEBUGGING FOLDER`.

It ignores Ctrl-C, which its parent handles. When the parent ends for any reason, it removes its unfinished files and
ends.
"""

from __future__ import annotations

import logging
import os
import pickle
import queue
import signal
import sys
import threading
import traceback
from typing import Any, BinaryIO

from ....engine.errors import Error
from .stopping import end_at_once, end_on_signals
from .streams import drop, quiet_libraries


def serve(level: int, debugging: bool, folder: str) -> None:
    """Run jobs until the parent closes the pipe."""
    end_on_signals()
    with open(os.dup(0), "rb") as requests, open(os.dup(1), "wb") as answers:
        drop(0)  # libraries and their child processes must not use the pipes
        drop(1)
        if not debugging:
            quiet_libraries()
        logging.basicConfig(format="%(message)s", level=level)
        os.chdir(folder)
        _Server(requests, answers, debugging).serve()


class _Server:
    """Runs one job at a time, while a thread watches whether the parent is alive."""

    def __init__(self, requests: BinaryIO, answers: BinaryIO, debugging: bool):
        self._requests, self._answers, self._debugging = requests, answers, debugging
        self._waiting: queue.SimpleQueue[bytes | None] = queue.SimpleQueue()
        self._busy = False
        self._listener = threading.Thread(target=self._listen, daemon=True)

    def serve(self) -> None:
        """Answer requests until the pipe is closed."""
        self._listener.start()
        while (request := self._waiting.get()) is not None:
            answer = self._answer(request)
            self._busy = False
            self._answers.write(answer)
            self._answers.flush()
        self._listener.join()

    def _listen(self) -> None:
        while True:
            try:
                request = pickle.load(self._requests)
            except (EOFError, OSError, pickle.UnpicklingError):  # the parent has ended, perhaps while sending
                break
            self._busy = True
            self._waiting.put(request)
        if self._busy:
            end_at_once(signal.SIGTERM)
        self._waiting.put(None)

    def _answer(self, request: bytes) -> bytes:
        """(result, None) or (None, exception), pickled."""
        try:
            work, job = pickle.loads(request)
            return pickle.dumps((work(job), None))
        except Exception as error:
            if self._debugging:
                traceback.print_exc()
            return _pickled(error)


def _pickled(error: Exception) -> bytes:
    try:
        pickled = pickle.dumps((None, error))
        pickle.loads(pickled)  # exceptions with required arguments fail here
        return pickled
    except Exception:
        return pickle.dumps((None, Error(f"internal, {type(error).__name__}: {error}")))


def main(level: str, debugging: str, folder: str) -> Any:
    """Run the worker."""
    try:
        serve(int(level), debugging == "1", folder)
    except BrokenPipeError:  # the parent has gone
        end_at_once(signal.SIGTERM)


if __name__ == "__main__":
    main(*sys.argv[1:])
