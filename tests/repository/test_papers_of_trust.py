# SPDX-License-Identifier: Apache-2.0
"""What an adopter reads and installs holds together: papers, metadata, recipes, workflows, and no network."""

from __future__ import annotations

import re
import subprocess
import sys
import tarfile
import tomllib
from pathlib import Path

import oiiotex_studio
import pytest

import oiiotex
from tools import dist, licenses
from tools.platforms import PLATFORMS, TESTS

ROOT = Path(__file__).parents[2]
PAPERS = ("SECURITY", "GOVERNANCE", "CODE_OF_CONDUCT", "ROADMAP", "ADOPTERS", "RELEASE", "CONTRIBUTING")
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
STUDIO = tomllib.loads((ROOT / "studio" / "pyproject.toml").read_text())["project"]
TARGETS = set(re.findall(r"^([a-z][\w-]*):", (ROOT / "Makefile").read_text(), re.MULTILINE))


@pytest.mark.parametrize("name", PAPERS)
def test_a_paper_names_files_and_targets_that_exist(name):
    text = (ROOT / f"{name}.md").read_text()
    for path in re.findall(r"`((?:tests|docs|tools|benchmarks|hosts|recipes|LICENSES|\.github|\.ci)/[^`* ]*)`", text):
        if "NAME" in path:
            continue
        assert (ROOT / path).exists(), path
    for words in re.findall(r"`make ([^`]+)`", text):
        assert {word for word in words.split() if "=" not in word} <= TARGETS, words


def test_versions_agree():
    plugin = tomllib.loads((ROOT / "hosts" / "openimageio" / "pyproject.toml").read_text())
    version = oiiotex.__version__
    assert plugin["project"]["version"] == oiiotex_studio.__version__ == version
    assert STUDIO["dependencies"][0].startswith(f"oiiotex>={version},<")  # released together
    assert f"oiiotex=={version}" in plugin["project"]["dependencies"]
    assert set(plugin["project"]["dependencies"]) & set(plugin["build-system"]["requires"])  # the same OpenImageIO
    quoted = {"conda-forge/recipe.yaml": r'version: "(.+)"', "rez/package.py": r'version = "(.+)"',
              "docker/Dockerfile": r"VERSION=(.+)", "homebrew/oiiotex.rb": r"oiiotex-([\d.]+)\.tar"}  # fmt: skip
    for name, form in quoted.items():
        assert re.search(form, (ROOT / "recipes" / name).read_text())[1] == version, name
    assert f"## [{version}]" in (ROOT / "CHANGELOG.md").read_text()
    blender = tomllib.loads((ROOT / "hosts" / "blender" / "oiiotex_blender" / "blender_manifest.toml").read_text())
    assert blender["version"] == version


def test_the_conda_recipe_requires_what_the_wheel_does():
    other = {"openimageio": "py-openimageio", "cityhash": "python-cityhash"}
    recipe = (ROOT / "recipes" / "conda-forge" / "recipe.yaml").read_text()
    for line in PROJECT["dependencies"]:
        name, bound = re.fullmatch(r"([\w-]+)(>=[\d.]+)", line).groups()
        assert f"- {other.get(name.lower(), name.lower())} {bound}" in recipe


def test_every_dependency_has_a_tested_version_that_its_bound_allows():
    pins = dict(re.findall(r"^([\w.-]+)==([\w.]+)", (ROOT / "constraints.txt").read_text(), re.MULTILINE))
    pins = {licenses.normalized(name): version for name, version in pins.items()}
    for line in (*PROJECT["dependencies"], *STUDIO["dependencies"][1:]):
        name, bound = re.fullmatch(r"([\w-]+)>=([\d.]+)", line).groups()
        numbers = [[int(n) for n in re.findall(r"\d+", text)] for text in (pins[licenses.normalized(name)], bound)]
        assert numbers[0] >= numbers[1], name


def test_every_dependency_is_in_the_table_of_licenses():
    table = licenses.PAGE.read_text()
    for project, first in ((PROJECT, 0), (STUDIO, 1)):
        for line in project["dependencies"][first:]:
            name = re.match(r"[\w-]+", line)[0]
            row = rf"^\| {name} \| .+ \| .+ \| {project['name']} \|$"
            assert re.search(row, table, re.MULTILINE | re.IGNORECASE), name


def test_links_of_the_readme_are_absolute_on_pypi():
    text = dist.absolute_links((ROOT / "README.md").read_text(), "https://x.org/y", "v1")
    assert not re.search(r"\]\((?!https?:)", text)
    for kind, path in re.findall(r"\]\(https://x.org/y/(blob|raw)/v1/([^)#]+)", text):
        assert (ROOT / path).exists() and (kind == "raw") == path.endswith((".jpg", ".png"))


def test_an_archive_has_one_time_and_user(tmp_path):
    for number in (1, 2):
        with tarfile.open(tmp_path / f"{number}.tar.gz", "w:gz") as tar:
            for name in ("a/x.py", "a/b.egg-info/SOURCES.txt")[:: 3 - 2 * number]:
                member = tarfile.TarInfo(name)
                member.mtime, member.uid, member.uname = number, number, str(number)
                tar.addfile(member)
    one, two = (dist.normalized(tmp_path / f"{number}.tar.gz", 1000) for number in (1, 2))
    assert one == two
    assert [path.name for path in dist.unpacked(one, tmp_path / "there").iterdir()] == ["x.py"]


def test_workflows_call_targets_and_pin_actions():
    flows = sorted((ROOT / ".github" / "workflows").glob("*.yml"))
    assert [path.stem for path in flows] == ["fuzz", "lint", "scorecard", "site", "tests", "wheels"]
    for text in (path.read_text() for path in flows):
        assert all(re.fullmatch(r"[\w./-]+@[0-9a-f]{40}  # v.+", one) for one in re.findall(r"uses: (.+)", text))
        made = {word for line in re.findall(r"make ([\w -]+)", text) for word in line.split() if word.islower()}
        assert made <= TARGETS, made
        assert "permissions:\n  contents: read" in text


def test_every_classified_python_is_a_platform():
    versions = {one.rsplit(" ", 1)[-1] for one in PROJECT["classifiers"] if re.search(r":: 3\.\d+$", one)}
    assert versions == {row.python for row in PLATFORMS}
    assert all((ROOT / word).exists() for word in TESTS if word.endswith(".py"))


SCRIPT = """
import sys
def watch(event, args):
    if event in ("socket.getaddrinfo", "socket.gethostbyname") or event in ("socket.connect", "socket.bind"):
        if len(args) < 2 or not isinstance(args[1], (str, bytes)):  # another address than a Unix socket's
            raise SystemExit(f"network: {event} {args}")
sys.addaudithook(watch)
import socket
if sys.argv[1] == "connect":
    socket.create_connection(("127.0.0.1", 9))
from oiiotex.oiiotool.cli.main import main
main(sys.argv[1:])
"""


@pytest.mark.parametrize("connects", [False, True], ids=["a line", "what connects is noticed"])
def test_a_line_opens_no_connection(photo, tmp_path, connects):
    line = [str(photo), "--texsuperpixel:count=20", "-o", str(tmp_path / "out.exr")]
    words = [sys.executable, "-c", SCRIPT, *(["connect"] if connects else line)]
    done = subprocess.run(words, capture_output=True, text=True)
    assert (done.returncode == 0, "network: " in done.stderr) == (not connects, connects), done.stderr


def test_the_source_archive_has_every_package_that_tests_import():
    manifest = (ROOT / "MANIFEST.in").read_text()
    folders = {path.name for path in ROOT.iterdir() if (path / "__init__.py").exists()}
    assert {"oiiotex", "tests", "tools", "benchmarks"} <= folders
    assert folders <= set(re.findall(r"^graft (\S+)", manifest, re.MULTILINE))
