# SPDX-License-Identifier: Apache-2.0
"""The page's server as it is installed, and Debian's Chromium that looks at it."""

from __future__ import annotations

import contextlib
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import IO

import pytest

FLAGS = [
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
]
DRAWING = (
    *(flag for flag in FLAGS if flag != "--disable-gpu"),
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--enable-unsafe-webgpu",
    "--use-webgpu-adapter=swiftshader",
)  # on the CPU
TOKEN = "0123456789abcdef"


class Served:
    """`oiiotex ... --texlive` in a folder, until it is told to end.

    Attributes
    ----------
    url : str
        Of the page.
    port : int
    process : subprocess.Popen
    """

    def __init__(self, folder: Path, *words: str, live: str = "", runtime: Path, errors: IO[bytes] | None = None):
        line = [sys.executable, "-P", "-m", "oiiotex", "--cache", "1024", *words]
        line.append(f"--texlive:open=0:token={TOKEN}{live}")
        environment = os.environ | {"XDG_RUNTIME_DIR": str(runtime)}
        self.process = subprocess.Popen(
            line, cwd=folder, env=environment, stdout=subprocess.PIPE, stderr=errors, text=True
        )
        assert self.process.stdout is not None
        self.url = self.process.stdout.readline().split()[0]
        self.port = int(self.url.split(":")[2].split("/")[0])

    def end(self, number: int = signal.SIGINT) -> int:
        """Tell it to end; its exit code."""
        self.process.send_signal(number)
        return self.process.wait(20)


def resident_pid(runtime: Path) -> int:
    """The process that works for servers of that runtime folder.

    Raises
    ------
    LookupError
        There is none.
    """
    for process in Path("/proc").glob("[0-9]*"):
        try:
            command, environment = ((process / name).read_bytes() for name in ("cmdline", "environ"))
        except OSError:  # somebody else's, or it has just ended
            continue
        if b"oiiotex.oiiotool.service" in command and f"XDG_RUNTIME_DIR={runtime}\0".encode() in environment:
            return int(process.name)
    raise LookupError(runtime)


def end_resident(runtime: Path) -> None:
    """End the process that works for servers of that runtime folder, which else waits ten minutes for others."""
    with contextlib.suppress(LookupError, ProcessLookupError):
        os.kill(resident_pid(runtime), signal.SIGTERM)


@contextlib.contextmanager
def chromium(flags: Sequence[str] = FLAGS) -> Iterator[object]:
    """A browser of Playwright's; tests are skipped, loudly, where there is none."""
    path = shutil.which("chromium")
    if path is None:
        pytest.skip("NOT RUN: there is no Chromium (apt-get install chromium)")
    playwright = pytest.importorskip("playwright.sync_api", reason="NOT RUN: no playwright (pip install oiiotex[test])")
    with playwright.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=path, headless=True, args=list(flags))
        yield browser
        browser.close()


def watch_clipboard(page) -> None:
    """Let `copied_text` wait for the next text that the page copies."""
    page.evaluate(
        "() => { window.copying = new Promise((done) => {"
        " navigator.clipboard.writeText = async (text) => done(text); }); }"
    )


def copied_text(page) -> str:
    """The text that the page copies, without opening a dialog."""
    text = page.evaluate("() => window.copying")
    assert page.query_selector("dialog[open]") is None
    return text
