# SPDX-License-Identifier: Apache-2.0
"""The share of kernels in a filter's CPU time. `python -m benchmarks.kernels.share [--runs N] [NAME ...]`.

It requires Linux and a CPU runtime: the time of the runtime's threads is that of the kernels, plus the runtime's
copies, which are subtracted by their events. Each line runs N times in a separate process. Medians of CPU seconds (user
and system, all threads) are printed:

start: the interpreter, imports, parsing, opening the device and its programs, as in any line.
op: from the first word until all pixels are computed: reading the exemplar, color, analysis, kernels, gathers.
kernels: the part of `op` that the runtime's threads used.
whole: the whole line, including `start` and encoding to EXR.

Shares are of `op`, of `start` and `op`, and of the whole.
"""

from __future__ import annotations

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

PHOTO = Path(os.environ.get("OIIOTEX_TEST_DATA", "../shared/data")).resolve() / "photos" / "castle_brick_broken.jpg"
SPACE = ("--iscolorspace", "srgb_rec709_scene")
_PROGRAM = (sys.executable, "-m", "oiiotex")
CROP = "256x256+200+150"
LINES = {
    "synth 1k": (True, "--texsynth:size=1024x1024"),
    "synth 4k": (True, "--texsynth:size=4096x4096"),
    "quilt 1k": (True, "--texquilt:size=1024x1024"),
    "quilt 4k": (True, "--texquilt:size=4096x4096"),
    "quilt photo 4k": (False, "--texquilt:size=4096x4096"),
    "superpixel": (False, "--texsuperpixel"),
    "label": (False, "--texlabel"),
}
NAMES = ("start", "op", "kernels")


def measured(words: list[str]) -> tuple[float, ...]:
    """CPU seconds by `NAMES`, of a line in this process."""
    import oiiotex.opencl.device
    from oiiotex.cli import vocabulary as language
    from oiiotex.cli.files.reading import read_input
    from oiiotex.cli.language import parse
    from oiiotex.cli.language.sequences import frames
    from oiiotex.cli.running import tasks
    from oiiotex.cli.stack.chain import Chain
    from oiiotex.core.demand import bands
    from oiiotex.session.progress import Progress

    runtime: set[int] = set()
    opening = 0.0
    build, wait = oiiotex.opencl.device.Program.__init__, oiiotex.opencl.device.open_device

    def opened(*given: object) -> object:
        nonlocal opening
        before, then = _threads(), time.process_time()
        found = wait(*given)
        if not runtime:
            runtime.update(_threads() - before)
        opening += time.process_time() - then
        return found

    def built(self: object, *given: object) -> None:
        nonlocal opening
        then = time.process_time()
        build(self, *given)
        opening += time.process_time() - then

    oiiotex.opencl.device.open_device, oiiotex.opencl.device.Program.__init__ = opened, built
    command = parse.parse(words, language.LANGUAGE)
    (frame,) = frames(words, language.LANGUAGE.takes)
    session = tasks.session_for(command, words)
    session.progress = Progress()
    session.change(profile=True)
    start = time.process_time()
    chain = Chain(session, read_input, frame)
    chain.run(command.steps)
    for part in chain.top.parts:
        for window in bands(part):
            part.read(window)
    session.resources.device.collect(session.resources.stats)
    op = time.process_time() - start - opening
    copies = sum(session.resources.stats.seconds.get(name, 0.0) for name in ("upload", "download", "fill"))
    kernels = sum(map(_used, runtime)) - copies
    return start + opening, op, kernels


def _threads() -> set[int]:
    own = {thread.native_id for thread in threading.enumerate()}
    return {int(name) for name in os.listdir("/proc/self/task")} - own


def _used(thread: int) -> float:
    return int(Path(f"/proc/self/task/{thread}/schedstat").read_text().split()[0]) * 1e-9


def whole(words: list[str], out: str) -> float:
    """CPU seconds of the line as it is typed."""
    child = subprocess.Popen([*_PROGRAM, "-q", *words, "-o", out])
    _, status, used = os.wait4(child.pid, 0)
    child.returncode = os.waitstatus_to_exitcode(status)
    if child.returncode:
        sys.exit(f"oiiotex failed: {words}")
    return used.ru_utime + used.ru_stime


def main() -> None:
    if sys.argv[1:2] == ["--line"]:
        print(*measured(sys.argv[2:]))
        return
    asked = argparse.ArgumentParser(description="Which share of a filter's CPU seconds its kernels take.")
    asked.add_argument("--runs", type=int, default=3)
    asked.add_argument("names", nargs="*", default=list(LINES), metavar="NAME", help=", ".join(LINES))
    given = asked.parse_args()
    print(f"{'line':16s} {'start':>6s} {'op':>6s} {'kernels':>8s} {'whole':>6s}   of op  + start  whole")
    with tempfile.TemporaryDirectory() as folder:
        crop, out = f"{folder}/crop.png", f"{folder}/out.exr"
        subprocess.run([*_PROGRAM, "-q", PHOTO, "--crop", CROP, "--fullpixels", "-o", crop], check=True)
        for name in given.names:
            small, op = LINES[name]
            words = [crop if small else str(PHOTO), *SPACE, op]
            rows = [_run(words, out) for _ in range(1 + given.runs)][1:]  # the first one compiles and fills caches
            start, op_seconds, kernels, all_seconds = map(statistics.median, zip(*rows, strict=True))
            shares = (f"{100 * kernels / of:6.0f} %" for of in (op_seconds, start + op_seconds, all_seconds))
            print(f"{name:16s} {start:6.2f} {op_seconds:6.2f} {kernels:8.2f} {all_seconds:6.2f}", *shares, flush=True)


def _run(words: list[str], out: str) -> tuple[float, ...]:
    line = [sys.executable, __file__, "--line", *words]
    found = subprocess.run(line, check=True, capture_output=True, text=True).stdout.split()[-len(NAMES) :]
    return (*map(float, found), whole(words, out))


if __name__ == "__main__":
    main()
