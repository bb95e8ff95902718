# SPDX-License-Identifier: Apache-2.0
"""What is shown while a run works: on a terminal a bar, in a log a line now and then."""

from __future__ import annotations

import os
import pty
import sys
import time

import pytest

from oiiotex.engine.session.progress import WHOLE, Progress
from oiiotex.engine.stats import Stats
from oiiotex.oiiotool.cli.running import progress
from oiiotex.oiiotool.cli.running.progress import Display

LINE = ("--texstationarize:size=64x64:iterations=5", "-o", "tile.exr")
# a bar appears at once, not after a second of work
EARLY = """
import sys
from oiiotex.oiiotool.cli.running import progress
progress._QUIET, progress._TICK = {quiet}, 0.02
from oiiotex.oiiotool.cli.main import main
main(sys.argv[1:])
"""


def on_a_terminal(folder, *words, quiet=0.0) -> str:
    """What the program shows on a terminal that says nothing of its size."""
    pid, terminal = pty.fork()
    if pid == 0:
        os.chdir(folder)
        os.execv(sys.executable, [sys.executable, "-c", EARLY.format(quiet=quiet), *words])
    shown = b""
    while True:
        try:
            piece = os.read(terminal, 4096)
        except OSError:
            break
        if not piece:
            break
        shown += piece
    assert os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]) == 0, shown
    os.close(terminal)
    return shown.decode()


@pytest.mark.parametrize("more", [(), ("-v",)])
def test_a_terminal_shows_stage_share_rate_and_time_left(photo, more):
    shown = on_a_terminal(photo.parent, *more, photo.name, *LINE)
    assert "--texstationarize: " in shown and "%|" in shown and "it/s" in shown


@pytest.mark.parametrize("option", ["-q", "--noprogress"])
def test_it_can_be_turned_off(photo, option):
    assert "%|" not in on_a_terminal(photo.parent, option, photo.name, *LINE)


def test_a_short_run_shows_nothing(photo):
    assert on_a_terminal(photo.parent, photo.name, "-o", "copy.png", quiet=progress._QUIET) == ""


def test_a_log_has_a_line_now_and_then(photo, monkeypatch, capsys):
    monkeypatch.setattr(progress, "_LINES", 0.3)
    monkeypatch.setattr(progress, "_TICK", 0.02)
    display, stats = Display(terminal=False), Stats()
    stats.watch = display.stage
    display.frame(2, 5)
    begun = time.monotonic()
    with display.shown(), stats.time("--texlabel"), stats.time("superpixels"):
        for n in range(10):
            display.advance(n, 10)
            time.sleep(0.1)
    lines = capsys.readouterr().err.splitlines()
    assert 2 <= len(lines) <= (time.monotonic() - begun) / 0.3
    assert all(line.startswith("frame 2/5: --texlabel superpixels: ") for line in lines)
    assert "% " in lines[-1].replace("%,", "% ") and "s left" in lines[-1]


def test_stages_of_an_op_have_their_shares_of_one_whole():
    told = []
    first, second = Progress(lambda done, total: told.append((done, total))).stages(1, 3)
    first.advance(200, 400)
    second.advance(4, 8)
    second.advance(0, 9)  # another attempt
    second.advance(9, 9)
    assert told == [(n, WHOLE) for n in (WHOLE // 8, 5 * WHOLE // 8, 5 * WHOLE // 8 + 1, WHOLE)]


def test_the_time_left_is_that_of_the_whole_op_and_not_of_its_innermost_stage(monkeypatch, capsys):
    clock = [0.0]
    monkeypatch.setattr(progress.time, "monotonic", lambda: clock[0])
    display, stats = Display(terminal=False), Stats()
    stats.watch = display.stage
    with stats.time("--texquilt"):
        for n in range(1, 4):
            with stats.time("inner"):
                clock[0] += 20
            display.advance(n, 10)
            display._say(clock[0])
        display.advance(1, 10)  # another attempt
        clock[0] += 20
        display.advance(2, 10)
        display._say(clock[0])
    shown = capsys.readouterr().err.splitlines()
    assert [line.partition(" s, ")[2] for line in shown] == [
        "10 %, 180 s left", "20 %, 160 s left", "30 %, 140 s left", "20 %, 160 s left",
    ]  # fmt: skip


def test_work_that_was_not_expected_adds_to_the_whole():
    told = []
    outer = Progress(lambda done, total: told.append((done, total))).stages(1, 1)
    first, second, third = next(outer).stages(1, 2, 1)
    first.advance(1, 1)
    second.advance(9, 10)
    second.lengthen(1)  # half of the inner whole, a quarter of the outer
    second.advance(0, 10)
    second.advance(5, 10)
    second.advance(10, 10)
    third.advance(1, 1)
    next(outer).advance(1, 1)
    shares = [round(done / total, 2) for done, total in told]
    assert shares == [0.12, 0.35, 0.28, 0.39, 0.5, 0.6, 1.0]
    assert [done for done, _ in told] == sorted(done for done, _ in told)


def test_a_stage_that_reports_nothing_is_expected_to_end(monkeypatch, capsys):
    clock = [0.0]
    monkeypatch.setattr(progress.time, "monotonic", lambda: clock[0])
    display, stats = Display(terminal=False), Stats()
    stats.watch = display.stage
    with stats.time("--texlabel"):
        clock[0] = 20
        display.advance(2, 10)
        for now in (60, 90, 120):
            clock[0] = now
            display._say(now)
        display.advance(8, 12)  # longer than expected
        display._say(130)
    shown = capsys.readouterr().err.splitlines()
    assert [line.partition("%")[2] for line in shown] == [", 40 s left", ", 10 s left", "", ", 50 s left"]
