# SPDX-License-Identifier: Apache-2.0
"""`make dist`: source archives and wheels of the last commit, of core and studio, in dist/, with their checksums.

They are built twice: from the commit, and from the core's source archive of the first build, which has the whole
repository. Both must have the same bytes.
Links of the README are made absolute, for PyPI's page.
"""

from __future__ import annotations

import argparse
import gzip
import hashlib
import io
import os
import re
import subprocess
import sys
import tarfile
import tempfile
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
SUMS = "SHA256SUMS"


def git(*words: str) -> bytes:
    """The output of git in the checkout."""
    return subprocess.run(["git", *words], cwd=ROOT, check=True, stdout=subprocess.PIPE).stdout


def build(kind: str, source: Path, into: Path) -> Path:
    """Build one distribution of a source folder: `kind` is sdist or wheel."""
    words = [sys.executable, "-m", "build", "--installer", "uv", f"--{kind}", "--outdir", str(into), str(source)]
    done = subprocess.run(words, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    if done.returncode != 0:
        sys.exit(done.stdout)
    (made,) = into.glob("*.tar.gz" if kind == "sdist" else "*.whl")
    return made


def normalized(archive: Path, time: int) -> bytes:
    """A .tar.gz with its members in order, of one user and time, without setuptools' notes of the build."""
    packed = io.BytesIO()
    with (
        tarfile.open(archive) as old,
        gzip.GzipFile(fileobj=packed, mode="wb", filename="", mtime=time) as zipped,
        tarfile.open(fileobj=zipped, mode="w", format=tarfile.GNU_FORMAT) as new,
    ):
        for member in sorted(old.getmembers(), key=lambda one: one.name):
            if ".egg-info" in member.name:
                continue
            member.mtime, member.uid, member.gid, member.uname, member.gname = time, 0, 0, "", ""
            member.mode = 0o755 if member.isdir() or member.mode & 0o100 else 0o644
            member.pax_headers = {}
            new.addfile(member, old.extractfile(member) if member.isfile() else None)
    return packed.getvalue()


def unpacked(archive: bytes, into: Path) -> Path:
    """Unpack a tar archive with one folder, and return that folder."""
    into.mkdir()
    with tarfile.open(fileobj=io.BytesIO(archive)) as tar:
        tar.extractall(into, filter="data")
    entries = list(into.iterdir())
    return entries[0] if len(entries) == 1 else into


def absolute_links(text: str, repository: str, tag: str) -> str:
    """A page of the repository's root with the addresses of its links and pictures in the tagged repository."""

    def address(link: re.Match[str]) -> str:
        return f"{link[1]}{link[2]}]({repository}/{'raw' if link[1] else 'blob'}/{tag}/{link[3]})"

    return re.sub(r"(!?)(\[[^\]]*)\]\((?!https?:|#)([^)\s]+)\)", address, text)


def with_absolute_links(source: Path) -> Path:
    """The source folder, whose README has absolute links."""
    project = tomllib.loads((source / "pyproject.toml").read_text())["project"]
    version = re.search(r'__version__ = "(.+)"', (source / "oiiotex" / "__init__.py").read_text())
    assert version
    readme = source / "README.md"
    readme.write_text(absolute_links(readme.read_text(), project["urls"]["Repository"], f"v{version[1]}"))
    return source


def all_of(source: Path, work: Path, time: int) -> dict[str, bytes]:
    """Source archives and wheels of core and studio, by file name; a wheel is built from its archive."""
    files = {}
    for project in (source, source / "studio"):
        into = work / project.name
        sdist = build("sdist", project, into / "sdist")
        archive = normalized(sdist, time)
        wheel = build("wheel", unpacked(archive, into / "unpacked"), into / "wheel")
        files |= {sdist.name: archive, wheel.name: wheel.read_bytes()}
    return files


def main() -> None:
    """Build, compare and write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--into", type=Path, default=ROOT / "dist")
    into: Path = parser.parse_args().into.resolve()
    if git("status", "--porcelain").strip():
        print("WARNING: uncommitted changes are not in the distributions")
    time = int(git("log", "-1", "--format=%ct"))
    os.environ["SOURCE_DATE_EPOCH"] = str(time)
    with tempfile.TemporaryDirectory() as name:
        work = Path(name)
        commit = with_absolute_links(unpacked(git("archive", "HEAD"), work / "commit"))
        first = all_of(commit, work / "first", time)
        second = all_of(next((work / "first" / "commit" / "unpacked").iterdir()), work / "second", time)
    if first != second:
        sys.exit(f"not reproducible: {', '.join(file for file in first if first[file] != second.get(file))}")
    into.mkdir(exist_ok=True)
    for file, data in first.items():
        (into / file).write_bytes(data)
    sums = "".join(f"{hashlib.sha256(data).hexdigest()}  {file}\n" for file, data in sorted(first.items()))
    (into / SUMS).write_text(sums)
    print(sums, end="")


if __name__ == "__main__":
    main()
