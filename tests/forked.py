# SPDX-License-Identifier: Apache-2.0
"""The program in a fork of a process that has loaded it: a test pays for its line, not for a second of imports.

Nothing of a line is looked at before the fork, and no device is opened. Tests of the start itself, of the environment
or of signals run the installed program as it is.
"""

from __future__ import annotations

import atexit
import os
import subprocess
import sys
import tempfile
from multiprocessing import get_context
from pathlib import Path
from types import ModuleType

FORKS = get_context("forkserver")
FORKS.set_forkserver_preload(["tests.forked", "tests.loaded"])
FEW_PLACES = "OIIOTEX_TEST_FEW_PLACES"  # set by the fixture of that name, for lines
spent = 0.0  # CPU seconds of all lines


def run(words: list[str], folder: Path, timeout: float) -> subprocess.CompletedProcess:
    """Run `oiiotex WORDS` in `folder`, as `subprocess.run` does with `capture_output` and `text`."""
    global spent
    with tempfile.TemporaryDirectory() as outputs:
        *files, seconds = (Path(outputs, name) for name in ("out", "error", "seconds"))
        process = FORKS.Process(
            target=_line, args=(words, str(folder), dict(os.environ), list(map(str, files)), str(seconds))
        )
        process.start()
        process.join(timeout)
        if process.is_alive():
            process.kill()
            process.join()
            raise subprocess.TimeoutExpired(words, timeout)
        spent += float(seconds.read_text()) if seconds.exists() else 0.0
        printed = [file.read_bytes().decode(errors="surrogateescape") if file.exists() else "" for file in files]
    return subprocess.CompletedProcess(["oiiotex", *words], process.exitcode, *printed)


def fewer() -> list[tuple[ModuleType, str, int]]:
    """Modules, constants of theirs, and what these are where nobody asks how good a result is."""
    from oiiotex.synthesis.quality import wholeness
    from oiiotex.synthesis.quilting import label_growth

    return [(wholeness, "_PLACES", 100), (label_growth, "_ITERATIONS", 4)]


def _line(words: list[str], folder: str, environment: dict[str, str], files: list[str], seconds: str) -> None:
    """In the fork: what a shell sets up, then the program."""
    from oiiotex.oiiotool.cli.main import main
    from tests import loaded

    if environment.pop(FEW_PLACES, ""):
        for module, constant, few in fewer():
            setattr(module, constant, few)

    os.chdir(folder)
    os.environ.clear()
    os.environ.update(environment | loaded.ENVIRONMENT)
    for number, file in enumerate(files, 1):
        os.dup2(os.open(file, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o600), number)
    sys.stdout, sys.stderr = (os.fdopen(n, "w", buffering=1, closefd=False) for n in (1, 2))
    sys.argv = ["oiiotex", *words]
    try:
        main(words)
    finally:
        atexit._run_exitfuncs()  # as at the end of a program; a fork ends without
        sys.stdout.flush()
        Path(seconds).write_text(str(sum(os.times()[:4])))
