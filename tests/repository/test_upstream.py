# SPDX-License-Identifier: Apache-2.0
"""The reports of docs/upstream still show what they say: where one does not, OpenImageIO has fixed it."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import OpenImageIO as oiio
import pytest

FOLDER = Path(__file__).parents[2] / "docs" / "upstream"
REPORTS = sorted(path for path in FOLDER.glob("*.md") if path.name != "README.md")
FORM = (
    r"# (.+)\n\nOpenImageIO ([\d.]+), .+\n\n## Case\n\n```sh\n(.+?)```"
    r"\n\n## Actual\n\n```text\n(.+?)```\n\n## Expected\n\n.+"
)


def test_every_report_is_complete_and_listed():
    listed = re.findall(r"^\| \[(.+)\]\((.+)\) \|", (FOLDER / "README.md").read_text(), re.MULTILINE)
    told = [(re.fullmatch(FORM, path.read_text(), re.DOTALL)[1], path.name) for path in REPORTS]
    assert sorted(listed) == sorted(told) and len(told) > 10


@pytest.mark.slow
@pytest.mark.parametrize("path", REPORTS, ids=lambda path: path.stem)
def test_a_report_shows_what_it_says(tmp_path, path):
    report = re.fullmatch(FORM, path.read_text(), re.DOTALL)
    programs = [Path(oiio.__file__).parent / "bin", Path(sys.executable).parent, os.environ["PATH"]]
    there = os.environ | {"PATH": os.pathsep.join(map(str, programs))}
    done = subprocess.run(["bash", "-c", report[3]], cwd=tmp_path, env=there, capture_output=True, text=True)
    assert [line.strip() for line in done.stdout.strip().splitlines()] == report[4].strip().splitlines(), done.stderr
