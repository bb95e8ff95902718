# SPDX-License-Identifier: Apache-2.0
"""How an op is told to report the quality of its result, and to hold it to limits."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ..core.op import Op
from ..core.parameters import Words, param
from .report import FAIL_HELP, REPORT_HELP


@dataclass(frozen=True, kw_only=True)
class Reported(Op):
    """What has a quality report, made by `quality.report.Quality`; its output is `quality.report.REPORT`."""

    report: Path | None = param(None, help=REPORT_HELP)
    fail: Words | None = param(None, help=FAIL_HELP)
