# SPDX-License-Identifier: Apache-2.0
"""`make dist`: the source archive and the wheel of the last commit in dist/, with their checksums.

They are built twice: from the commit, and from the source archive of the first build. Both must be equal to the byte.
"""

from __future__ import annotations

import argparse
import gzip
import hashlib
import io
import os
import subprocess
import sys
import tarfile
import tempfile
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
    """A .tar.gz with its members in order, of one user and time: setuptools keeps those of the build, and its notes."""
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


def both(source: Path, work: Path, time: int) -> dict[str, bytes]:
    """Source archive and wheel of a source folder, by file name; the wheel is built from the archive."""
    sdist = build("sdist", source, work / "sdist")
    archive = normalized(sdist, time)
    wheel = build("wheel", unpacked(archive, work / "unpacked"), work / "wheel")
    return {sdist.name: archive, wheel.name: wheel.read_bytes()}


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
        first = both(unpacked(git("archive", "HEAD"), work / "commit"), work / "first", time)
        second = both(next((work / "first" / "unpacked").iterdir()), work / "second", time)
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
