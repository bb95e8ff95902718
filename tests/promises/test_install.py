# SPDX-License-Identifier: Apache-2.0
"""What an installation needs: the wheel's own files, a linker that may be missing, a device that may be missing."""

from __future__ import annotations

import json
import os
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from oiiotex.engine import machine
from oiiotex.engine.io.sealed import read_sealed
from oiiotex.engine.opencl import device_choice, runtime
from tests.conftest import oiiotex
from tools.docs.stubs import stub_text

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def sites(tmp_path_factory) -> Path:
    """Both wheels, each installed in a folder of its own."""
    folder = tmp_path_factory.mktemp("wheels")
    pip = [sys.executable, "-m", "pip", "-q"]
    for name, project in (("core", ROOT), ("studio", ROOT / "studio")):
        for words in (["wheel", "--no-deps", "-w", folder / f"{name}-dist", project],
                      ["install", "--no-deps", "--target", folder / name]):  # fmt: skip
            wheels = (folder / f"{name}-dist").glob("*.whl")
            subprocess.run([*pip, *words, *wheels], check=True, capture_output=True, cwd=folder)
    return folder


@pytest.mark.slow
def test_the_built_wheels_find_config_kernels_and_page(sites, tmp_path, photo):
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join((str(sites / "core"), str(sites / "studio")))}

    def python(*words: str) -> str:
        line = [sys.executable, *words]
        return subprocess.run(line, env=environment, cwd=tmp_path, capture_output=True, text=True).stdout

    for name, package in (("core", "oiiotex"), ("studio", "oiiotex_studio")):
        assert python("-c", f"import {package}; print({package}.__file__)").startswith(str(sites / name))
    assert "[[product]]" in python("-m", "oiiotex_studio.library.main", "recipe")
    assert (sites / "core" / "oiiotex" / "filters" / "__init__.pyi").read_text() == stub_text()
    page = "from importlib import resources as r; page = r.files('oiiotex_studio.live') / 'page'; "
    assert python("-c", page + "print((page / 'main.js').is_file())") == "True\n"
    line = "--texstationarize:size=64x64:iterations=2:measure=moments4"  # which reads a table of the package
    done = oiiotex(photo, line, "-o", "tile.png", cwd=tmp_path, env=environment)
    assert done.returncode == 0, done.stderr
    assert "--texlive" in oiiotex("--help", "viewing", cwd=tmp_path, env=environment).stdout


def without_linker(script: str, cache: str) -> subprocess.CompletedProcess:
    """Run a shell script in a mount namespace where every `ld` and gcc's folder are masked."""
    linkers = "/usr/bin/ld /usr/bin/*-ld /usr/bin/*ld.bfd /usr/bin/*ld.gold /usr/bin/ld.lld* /usr/local/bin/ld"
    mask = f"""
      for f in $(ls {linkers} 2>/dev/null); do mount --bind /dev/null $f || exit 77; done
      if [ -d /usr/lib/gcc ]; then mkdir -p {cache}/empty; mount --bind {cache}/empty /usr/lib/gcc || exit 77; fi
    """
    environment = {**os.environ, "XDG_CACHE_HOME": cache, "POCL_CACHE_DIR": f"{cache}/pocl"}
    os.makedirs(f"{cache}/pocl")
    command = ["unshare", "-m" if os.geteuid() == 0 else "-rm", "sh", "-c", mask + script]
    try:
        done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=300)
    except FileNotFoundError:
        pytest.skip("no unshare")
    if done.returncode == 77 or "unshare" in done.stderr:
        pytest.skip(f"cannot mask the linker: {done.stderr}")
    return done


@pytest.mark.slow
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="PoCL from PyPI is for Linux")
def test_without_a_linker_pocl_works_through_lld(tmp_path, photo):
    pytest.importorskip("ziglang")
    program = [sys.executable, "-m", "oiiotex"]
    words = [str(photo), "--texstationarize:size=64x64:iterations=2", "-o", f"{tmp_path}/tile.png"]
    script = shlex.join(program + words)
    done = without_linker(script, str(tmp_path / "cache"))
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "tile.png").exists()
    answers = [json.loads(read_sealed(p).read()) for p in (tmp_path / "cache" / "oiiotex").glob("probe-*")]
    assert [answer["works"]["linker"] for answer in answers] == ["lld"]
    assert any("ld" in words for _, words in answers[0]["failures"])


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="PoCL from PyPI is for Linux")
def test_without_any_linker_the_advice_is_one_line(tmp_path, photo):
    hide = (
        "from oiiotex.engine.opencl import runtime; runtime._zig = lambda: None; "
        "from oiiotex.oiiotool.cli.main import main; "
        f"main([{str(photo)!r}, '--texstationarize', '-o', {str(tmp_path / 'tile.png')!r}])"
    )
    done = without_linker(shlex.join([sys.executable, "-c", hide]), str(tmp_path / "cache"))
    assert done.returncode == 1
    assert done.stderr.strip().splitlines()[-1].endswith("pip install 'oiiotex[linker]'")
    assert len(done.stderr.strip().splitlines()) == 1, done.stderr


@pytest.mark.parametrize("words", [("--texstationarize", "-o", "x.png"), ("--texlive:open=0",)], ids=("tile", "page"))
def test_without_any_device_the_advice_is_one_line(photo, words):
    empty = {**os.environ, "OCL_ICD_VENDORS": "/nonexistent"}
    script = (
        "import pyopencl as cl\n"
        "def none(): raise cl.LogicError('no platform')\n"
        "cl.get_platforms = none\n"
        f"from oiiotex.oiiotool.cli.main import main; main([{str(photo)!r}, *{words!r}])"
    )
    done = subprocess.run([sys.executable, "-c", script], env=empty, capture_output=True, text=True, timeout=60)
    assert done.returncode == 1
    assert (
        "no OpenCL device: " in done.stderr and "install" in done.stderr and len(done.stderr.strip().splitlines()) == 1
    )


def test_a_probe_that_fails_in_its_process_is_reported(monkeypatch):
    info = next(d for d in device_choice.devices() if d.kind == "cpu")
    lanes, words = runtime._try_in_subprocess(info.handle, runtime.Attempt(cpu="no-such-cpu"))
    assert lanes == 0
    # it has a name already, or is none of a PoCL that can be told; or the compiler does not know it
    assert "knows the CPU" in words or "no-such-cpu" in words


def test_threads_follow_the_affinity_of_the_process():
    script = "from oiiotex.engine.opencl import runtime as r; r.load(); "
    script += "import os; print(os.environ['POCL_MAX_PTHREAD_COUNT'])"
    clean = {k: v for k, v in os.environ.items() if k != "POCL_MAX_PTHREAD_COUNT"}
    pinned = f"import os; os.sched_setaffinity(0, {{min(os.sched_getaffinity(0))}}); {script}"
    assert subprocess.run([sys.executable, "-c", pinned], env=clean, capture_output=True, text=True).stdout == "1\n"


def test_threads_follow_the_quota_of_the_cgroup(monkeypatch):
    monkeypatch.setattr(machine, "_quotas", lambda: [1.0])
    for name in ("POCL_MAX_PTHREAD_COUNT", "DPCPP_CPU_NUM_CUS"):
        monkeypatch.setenv(name, "")  # so that what it was comes back
        monkeypatch.delenv(name)
    runtime._prepared.__wrapped__(0)
    assert os.environ["POCL_MAX_PTHREAD_COUNT"] == str(machine.usable_threads()) == "1"
