# SPDX-License-Identifier: Apache-2.0
"""A pytest plugin that writes each outcome at once, so that an interrupted run keeps its results.

Each is a line of JSON in the file $OIIOTEX_TEST_REPORT: {"collected": count}, {"test": id, "outcome": ...}.
"""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest

_worker = ""  # of pytest-xdist, which reports to the process that started it


def pytest_configure(config: pytest.Config) -> None:
    global _worker
    _worker = getattr(config, "workerinput", {}).get("workerid", "")


def pytest_collection_finish(session: pytest.Session) -> None:
    if session.items and _worker in ("", "gw0"):
        _write(collected=len(session.items))


def pytest_collectreport(report: pytest.CollectReport) -> None:
    if report.failed and _worker in ("", "gw0"):
        _write(test=report.nodeid, outcome="failed", why=_why(report))


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    # a test is what its call was; setup and teardown count where they went wrong or left it out
    if not _worker and (report.when == "call" or report.outcome != "passed"):
        _write(test=report.nodeid, outcome=report.outcome, why=_why(report) if report.failed else "")


def _why(report: pytest.TestReport | pytest.CollectReport) -> str:
    crash = getattr(report.longrepr, "reprcrash", None)
    return crash.message if crash else str(report.longrepr)


def _write(**entry: object) -> None:
    with Path(os.environ["OIIOTEX_TEST_REPORT"]).open("a") as file:
        file.write(json.dumps(entry) + "\n")
