# SPDX-License-Identifier: Apache-2.0
"""Folders whose content is run or connected to: the user's alone, or a temporary one instead; no simulator unasked."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from oiiotex.engine.errors import DeviceError, Error, NoDeviceError
from oiiotex.engine.io.cache_folders import require_private
from oiiotex.engine.opencl import device_choice as devices
from oiiotex.engine.opencl.device import DeviceInfo
from tests.conftest import installed, save

pytestmark = pytest.mark.skipif(os.name != "posix", reason="owners and permissions of POSIX")
root_only = pytest.mark.skipif(os.name == "posix" and os.geteuid() != 0, reason="only root gives files away")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder of ours, all above it closed."""
    path = tmp_path / "home" / "cache"
    path.mkdir(parents=True, mode=0o700)
    return path


def refused(folder: Path) -> str:
    with pytest.raises(Error) as caught:
        require_private(folder)
    return str(caught.value)


def test_a_folder_of_ones_own_is_taken_by_name_and_by_link(folder, tmp_path):
    require_private(folder)
    (tmp_path / "link").symlink_to(folder)
    require_private(tmp_path / "link")


@pytest.mark.parametrize("mode", [0o777, 0o702, 0o1777])
def test_a_folder_that_others_can_write_is_refused(folder, mode, tmp_path):
    folder.chmod(mode)
    (tmp_path / "link").symlink_to(folder)
    assert "open to others" in refused(folder)
    assert "open to others" in refused(tmp_path / "link")


def test_a_folder_that_others_could_exchange_is_refused(folder):
    folder.parent.chmod(0o777)
    assert f"can write to {folder.parent}" in refused(folder)
    folder.parent.chmod(0o1777)  # as /tmp is
    require_private(folder)


@root_only
def test_a_folder_of_another_user_is_refused(folder):
    os.chown(folder, 12345, -1)
    assert "another user" in refused(folder)
    os.chown(folder, 0, -1)
    os.chown(folder.parent, 12345, -1)
    assert f"can write to {folder.parent}" in refused(folder)


@root_only
def test_a_link_of_another_user_is_refused(folder, tmp_path):
    link = tmp_path / "link"
    link.symlink_to(folder)
    os.lchown(link, 12345, -1)
    assert "another user" in refused(link)


@root_only
def test_a_group_may_write_if_it_is_the_users_own(folder):
    folder.chmod(0o770)
    os.chown(folder, 0, 0)
    require_private(folder)  # the group root of root
    os.chown(folder, 0, 12345)
    assert "open to others" in refused(folder)


# --- caches ---


def spoil_home(home: Path) -> None:
    home.write_text("no folder")


def spoil_cache(home: Path) -> None:
    (home / ".cache" / "oiiotex").mkdir(parents=True)
    (home / ".cache" / "oiiotex").chmod(0o777)


def spoil_kernels(home: Path) -> None:
    (home / ".cache" / "oiiotex" / "pocl").mkdir(parents=True)
    (home / ".cache" / "oiiotex" / "pocl").chmod(0o777)


@pytest.mark.parametrize(
    ("spoil", "verbose", "said"),
    [(spoil_home, "-v", 1), (spoil_cache, "--noprogress", 1), (spoil_kernels, "-q", 0)],
)
def test_without_a_safe_cache_folder_a_run_uses_a_temporary_one(tmp_path, spoil, verbose, said):
    home = tmp_path / "home"
    spoil(home)
    before = sorted(str(path) for path in home.rglob("*")) if home.is_dir() else []
    save(np.random.default_rng(0).random((24, 24, 3)), tmp_path / "a.exr", "float", "lin_rec709_scene")
    there = {k: v for k, v in os.environ.items() if k not in ("XDG_CACHE_HOME", "POCL_CACHE_DIR", "OIIOTEX_DEVICE")}
    there |= {"HOME": str(home), "TMPDIR": str(tmp_path)}
    done = installed("a.exr", "--texsuperpixel", verbose, "-o", "o.exr", cwd=tmp_path, env=there)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "o.exr").exists()
    text = done.stdout + done.stderr
    assert text.count("caches of this run are temporary") == said and "Error" not in text and "Warning" not in text
    assert not list(tmp_path.glob("oiiotex-cache-*"))
    assert before == (sorted(str(path) for path in home.rglob("*")) if home.is_dir() else [])


def test_the_temporary_folder_is_private_and_goes_with_the_process(tmp_path):
    script = "import os\nfrom oiiotex.engine.io.cache_folders import cache_folder\n"
    script += "f = cache_folder(); print(f.parent, oct(f.parent.stat().st_mode & 0o777), os.environ['POCL_CACHE_DIR'])"
    there = {**os.environ, "XDG_CACHE_HOME": str(Path(tmp_path, "none")), "TMPDIR": str(tmp_path)}
    (tmp_path / "none").write_text("")
    done = subprocess.run([sys.executable, "-c", script], env=there, capture_output=True, text=True, check=True)
    path, mode, kernels = done.stdout.split()
    assert mode == "0o700" and path.startswith(str(tmp_path)) and kernels.startswith(path)
    assert not Path(path).exists()


@pytest.mark.skipif(sys.platform == "win32", reason="limits of POSIX")
def test_no_room_for_compiled_kernels_is_one_line(tmp_path):
    """PoCL aborts without a word where it cannot write one; a limit on files is seen as a full disk is."""
    save(np.random.default_rng(0).random((24, 24, 3)), tmp_path / "a.exr", "float", "lin_rec709_scene")
    limited = "import resource, sys; resource.setrlimit(resource.RLIMIT_FSIZE, (1 << 20, 1 << 20));"
    limited += "from oiiotex.oiiotool.cli.main import main; main(sys.argv[1:])"
    words = [sys.executable, "-c", limited, "a.exr", "--texsuperpixel", "-q", "-o", "o.exr"]
    done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 1, done.stderr
    assert done.stderr.count("\n") == 1 and "no space for compiled kernels" in done.stderr
    assert not (tmp_path / "o.exr").exists()


# --- simulators ---


def test_a_simulator_is_used_only_where_it_is_named(monkeypatch):
    handle = SimpleNamespace(int_ptr=1)
    simulator = DeviceInfo(0, "other", "Oclgrind Simulator", "Oclgrind", "1.2", 1 << 27, handle)
    monkeypatch.setattr(devices, "devices", lambda threads=0: [simulator])
    monkeypatch.delenv("OIIOTEX_DEVICE", raising=False)
    with pytest.raises(NoDeviceError, match=r"Oclgrind Simulator.* --device"):
        devices.choose()
    assert devices.choose("oclgrind") is simulator
    with pytest.raises(DeviceError, match="no device 'gpu'"):
        devices.choose("gpu")
