# SPDX-License-Identifier: Apache-2.0
"""Run a topic's benchmarks and renew its page: `python -m benchmarks [TOPIC [WORD ...]]`.

Without words it prints the topics and their commands. A page benchmarks/results/TOPIC.md is hand-written, with lines

    `python -m benchmarks.TOPIC.NAME ARGUMENTS` (MACHINE, DATE, inputs HASH)

The text after such a line, up to the next one or the next heading, is the command's output. The command is run again,
and machine, date, hash and output are replaced. A WORD selects the commands that contain it. OUT in a command is an
empty folder: OUT/table.md is used instead of the printed output, and PNG files there are copied next to the page.
"""

from __future__ import annotations

import itertools
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from benchmarks.figures import inputs
from benchmarks.shared.measures import machine

FOLDER = Path(__file__).parent / "results"
ENTRY = re.compile(r"^`python (-m (?:benchmarks\.|pytest )[^`]+)` \(.*\)\n(?:(?!## |`python -m ).*\n)*", re.MULTILINE)


def commands(page: Path) -> list[str]:
    """The commands of a page, in its order."""
    return [match[1] for match in ENTRY.finditer(page.read_text())]


def output(command: str, page: Path) -> str:
    """The output of a command, as Markdown.

    Raises
    ------
    subprocess.CalledProcessError
        It failed.
    """
    with tempfile.TemporaryDirectory() as out:
        words = [word.replace("OUT", out) for word in shlex.split(command)]
        done = subprocess.run([sys.executable, *words], check=True, stdout=subprocess.PIPE, text=True).stdout
        for made in Path(out).glob("*.png"):
            shutil.copy(made, page.parent / f"{page.stem}_{made.name}")
        table = Path(out, "table.md")
        if table.exists():
            return table.read_text().strip()
    blocks = []
    for is_table, lines in itertools.groupby(done.strip().splitlines(), lambda line: line.startswith("|")):
        block = "\n".join(lines).strip("\n")
        blocks += [block] if is_table else [f"```\n{block}\n```"] if block else []
    return "\n\n".join(blocks)


def renew(page: Path, words: list[str]) -> bool:
    """Run the page's commands that contain one of the words, all without words; whether each gave a result."""
    chosen = [c for c in commands(page) if not words or any(word in c for word in words)]
    if not chosen:
        sys.exit(f"no command of {page.name} contains {' or '.join(words)}: expected a part of one of\n" + listed(page))
    failed = []
    for command in chosen:
        print(f"python {command}", flush=True)
        try:
            entry = f"`python {command}` ({machine()}, inputs {inputs(command)})\n\n{output(command, page)}\n\n"
        except subprocess.CalledProcessError as error:
            failed.append(command)
            print(f"exit status {error.returncode}: its table stays as it is", file=sys.stderr)
            continue
        text = ENTRY.sub(lambda m: entry if m[1] == command else m[0], page.read_text())  # noqa: B023 - called at once
        page.write_text(text.rstrip() + "\n")  # after each command: an interrupted run keeps what it has
    return not failed


def listed(page: Path) -> str:
    """A topic and its commands."""
    return "\n".join([page.stem, *(f"    python {command}" for command in commands(page))])


def main(words: list[str]) -> None:
    """List, or renew a page."""
    pages = {page.stem: page for page in sorted(FOLDER.glob("*.md"))}
    if not words or words[0] in ("-h", "--help"):
        print(__doc__.partition("\n")[0], *map(listed, pages.values()), sep="\n\n")
    elif words[0] not in pages:
        sys.exit(f"no topic is called {words[0]}: expected {', '.join(pages)}")
    elif not renew(pages[words[0]], words[1:]):
        sys.exit(1)


if __name__ == "__main__":
    main(sys.argv[1:])
