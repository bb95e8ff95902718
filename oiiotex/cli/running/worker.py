# SPDX-License-Identifier: Apache-2.0
"""A process that does jobs as `parallel.Workers` sends them: `oiiotex.cli.running.worker LEVEL DEBUGGING FOLDER`.

It is started deaf to Ctrl-C, which is for its parent, and stays so. Where the parent goes, however that is ended, it
goes too, and leaves nothing half.
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

from ...errors import Error
from .stopping import end_at_once, end_on_signals
from .streams import drop, quiet_libraries


def serve(level: int, debugging: bool, folder: str) -> None:
    """Do jobs until the parent has no more."""
    end_on_signals()
    with open(os.dup(0), "rb") as requests, open(os.dup(1), "wb") as answers:
        drop(0)  # neither libraries nor what they start read or write there
        drop(1)
        if not debugging:
            quiet_libraries()
        logging.basicConfig(format="%(message)s", level=level)
        os.chdir(folder)
        _Server(requests, answers, debugging).serve()


class _Server:
    """Does one job at a time, and listens meanwhile whether the parent is there."""

    def __init__(self, requests: BinaryIO, answers: BinaryIO, debugging: bool):
        self._requests, self._answers, self._debugging = requests, answers, debugging
        self._waiting: queue.SimpleQueue[bytes | None] = queue.SimpleQueue()
        self._busy = False
        self._listener = threading.Thread(target=self._listen, daemon=True)

    def serve(self) -> None:
        """Until there is no more."""
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
            except (EOFError, OSError, pickle.UnpicklingError):  # nobody is there, or died while asking
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
        pickle.loads(pickled)  # exceptions with fields of their own may not come back
        return pickled
    except Exception:
        return pickle.dumps((None, Error(f"internal, {type(error).__name__}: {error}")))


def main(level: str, debugging: str, folder: str) -> Any:
    """As the words say."""
    try:
        serve(int(level), debugging == "1", folder)
    except BrokenPipeError:  # the parent has gone
        end_at_once(signal.SIGTERM)


if __name__ == "__main__":
    main(*sys.argv[1:])
