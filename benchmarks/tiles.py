# SPDX-License-Identifier: Apache-2.0
"""What an artist asks of a tile, in one command: structure kept, nothing repeated, nothing lost.

python -m benchmarks.tiles

The tables of benchmarks.regularity and benchmarks.repetition over the photos of the test data; about ten minutes on two
cores.
"""

from __future__ import annotations

import subprocess
import sys


def main() -> int:
    """Run both, one after the other; the worst of their exit codes."""
    return max(
        subprocess.run([sys.executable, "-m", f"benchmarks.{name}"], check=False).returncode
        for name in ("regularity", "repetition")
    )


if __name__ == "__main__":
    sys.exit(main())
