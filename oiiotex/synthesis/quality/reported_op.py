# SPDX-License-Identifier: Apache-2.0
"""The parameters of ops that report the quality of their result and limit it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ...engine.core.op import Op
from ...engine.core.parameters import Words, param
from .report import FAIL_HELP, REPORT_HELP


@dataclass(frozen=True, kw_only=True)
class Reported(Op):
    """An op with a quality report, from `quality.report.Quality`. Its output is `quality.report.REPORT`."""

    report: Path | None = param(None, help=REPORT_HELP, example="report.json", advanced=True)
    fail: Words | None = param(None, help=FAIL_HELP, example="seam>1.3,repeat>4", advanced=True)
