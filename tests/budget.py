# SPDX-License-Identifier: Apache-2.0
"""CPU seconds of test files: a run tells which take more than twice their share of budget.toml.

Shares of one run are compared, not times: a slow machine or a busy one changes nothing, and nothing fails.
`make budget` writes the file again; `pytest --budget` does with the tests that it runs.
"""

from __future__ import annotations

import os
import tomllib
from collections import Counter
from collections.abc import Mapping
from pathlib import Path

from tests import forked

FILE = Path(__file__).with_name("budget.toml")
KINDS = ("fast", "slow")
MOST = 2.0  # times its share
LEAST = 0.005  # of a run: less is not worth a line
WHOLE = 0.8  # of the budget: a run of less is not a whole one


def seconds() -> float:
    """CPU seconds of this process, of those that it started and of lines that ran in forks."""
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system + forked.spent


def above(spent: Mapping[str, float], budget: Mapping[str, float]) -> list[str]:
    """A line for each file that takes more than its share; none where much of the suite is not run."""
    run, known = sum(spent.values()), sum(budget.get(file, 0.0) for file in spent)
    if not known or known < WHOLE * sum(budget.values()):
        return []
    scale = sum(spent[file] for file in spent if file in budget) / known
    return [
        f"ABOVE ITS BUDGET: {file}: {100 * now / run:.1f} % of the run, {100 * scale * own / run:.1f} % expected"
        for file, now in sorted(spent.items(), key=lambda item: -item[1])
        if now - MOST * scale * (own := budget.get(file, 0.0)) > LEAST * run
    ]


def read() -> dict[str, dict[str, float]]:
    """Seconds by kind and file."""
    return tomllib.loads(FILE.read_text()) if FILE.exists() else {kind: {} for kind in KINDS}


def write(spent: Mapping[str, Mapping[str, float]]) -> None:
    """Renew the files that were run, and forget those that are gone."""
    text, old = "# CPU seconds on two cores (AMD EPYC, Zen 4), kernels compiled: tests/budget.py\n", read()
    for kind in KINDS:
        files = {
            file: value for file, value in (old[kind] | spent[kind]).items() if any(FILE.parent.rglob(f"{file}.py"))
        }
        text += f"\n[{kind}]\n" + "".join(f"{file} = {files[file]:.1f}\n" for file in sorted(files))
    FILE.write_text(text)


def of_reports(reports: list[object]) -> dict[str, Counter[str]]:
    """Seconds by kind and file, of the reports of a run."""
    spent: dict[str, Counter[str]] = {kind: Counter() for kind in KINDS}
    for report in reports:
        for name, value in getattr(report, "user_properties", ()):
            if name == "cpu":
                spent["slow" if "slow" in report.keywords else "fast"][Path(report.fspath).stem] += value
    return spent
