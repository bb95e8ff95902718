# SPDX-License-Identifier: Apache-2.0
"""What an output's kind says, over every output of every filter; and the runner that makes parts, files and lines."""

from __future__ import annotations

READ = {"palette", "graph", "draw", "fromplan", "mesh", "motion", "lights"}  # name files that the op reads
