# SPDX-License-Identifier: Apache-2.0
"""Nothing of the current folder is run by what we start, in whichever way it is started."""

from __future__ import annotations

import os
import shlex
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from oiiotex.engine.machine import forget_current_folder, start
from oiiotex.engine.opencl import runtime
from tests import pictures
from tests.conftest import save

ROOT = Path(__file__).parents[2]
MODULES = (
    "sitecustomize", "usercustomize", "multiprocessing", "concurrent", "numpy", "scipy", "pyopencl",
    "OpenImageIO", "PyOpenColorIO", "oiiotex", "json", "random", "logging", "ssl", "socket", "typing",
    "asyncio", "yaml", "tornado", "msgpack", "cloudpickle", "distributed", "dask", "toolz", "psutil", "pickle",
    "queue", "runpy", "re", "tempfile", "threading", "subprocess", "shutil", "signal", "selectors", "struct",
    "hashlib", "platformdirs", "pytools", "ziglang", "mmh3", "threadpoolctl", "tqdm", "sqlite3", "contextlib",
    "dataclasses", "traceback", "zoneinfo",
)  # fmt: skip
PROGRAMS = (
    "oiiotool", "sh", "cat", "ld", "ld.lld", "gcc", "cc", "clang", "python3", "uname", "lscpu", "xdg-open",
)  # fmt: skip
RECIPE = 'schema = 1\n[[product]]\nname = "tile"\nline = "$maps --flip $outputs"\n'

# Each is a script in a Python of ours whose current folder is the planted one; `folder` is another one.
WAYS = {
    "a device is tried": """
from oiiotex.engine.opencl import device_choice, runtime
handle = next(d for d in device_choice.devices() if d.kind == "cpu").handle
assert runtime._try_in_subprocess(handle, runtime.Attempt())[0] or runtime._zig()
for attempt in runtime.attempts(""):
    runtime._try_in_subprocess(handle, attempt)
""",
    "a kernel is linked": """
program("photo.png", "--iscolorspace", "srgb_rec709_scene", "--texsuperpixel:count=20", "-o", "out.exr")
""",
    "frames in parallel": """
program("--frames", "1-2", "--parallel-frames", "--threads", "2", "photo.png", "--mulc", "0.5", "-o", "out.#.jpg")
""",
    "frames on a farm of this machine": """
program("--frames", "1-2", "--farm", "dask=local:1", "photo.png", "--mulc", "0.5", "-o", "out.#.png")
""",
    "shares on a farm of this machine": """
program("photo.png", "--blur", "5x5", "-o", "out.exr", "--farm", "dask=local:1")
""",
    "a library": """
from oiiotex_studio.library.main import main
main(["ingest", f"{folder}/photos", f"{folder}/library", "--recipe", f"{folder}/recipe.toml", "-q"])
""",
    "a library on a farm of this machine": """
from oiiotex_studio.library.main import main
words = ["--recipe", f"{folder}/recipe.toml", "-q", "--farm", "dask=local:1"]
main(["ingest", f"{folder}/photos", f"{folder}/library", *words])
""",
    "the resident process": """
from oiiotex.oiiotool.service.client import connect
from oiiotex.oiiotool.service.settings import ResidentSettings
client = connect(ResidentSettings(budget=1 << 28, idle=1))
print(client.hello()["pid"])
client.end()
""",
    "the door for hosts": """
import json, subprocess
from oiiotex.oiiotool.service.client import connect
from oiiotex.oiiotool.service.settings import ResidentSettings
text = json.dumps({"device": None})
isolated = [sys.executable, "-I", "-c", f"import sys; sys.path.insert(0, {root!r}); sys.argv[1:] = [{text!r}];"
    "import runpy; runpy.run_module('oiiotex.oiiotool.service.door', run_name='__main__')"]
print(subprocess.run(isolated, capture_output=True, text=True, check=True).stdout)
from oiiotex.engine.session import Session
connect(ResidentSettings.of(Session())).end()
""",
    "Blender's extension": """
import runpy, zipfile
runpy.run_path(f"{root}/hosts/blender/build.py")["build"](f"{folder}/extension.zip")
zipfile.ZipFile(f"{folder}/extension.zip").extractall(f"{folder}/oiiotex_blender")
open(f"{folder}/oiiotex_blender/__init__.py", "w").close()  # which needs bpy
sys.path.insert(0, folder)
from oiiotex_blender.process import Failed, Process
os.environ["PATH"] = os.pathsep.join((".", "", os.path.dirname(sys.executable)))
process = Process("python3")
connection = process._connected()
process.run(["--version"]).wait()
connection.close()
from oiiotex.oiiotool.service.client import connect
from oiiotex.oiiotool.service.settings import ResidentSettings
from oiiotex.engine.session import Session
connect(ResidentSettings.of(Session())).end()
""",
    "a JPEG": """
program("photo.png", "-o", "out.jpg")
""",
    "oiiotool of the wheel": """
program("--list-formats", "--buildinfo", "--colorconfiginfo")
""",
    "a browser": """
from oiiotex.engine.machine import forget_current_folder
forget_current_folder()  # as every line does
import webbrowser
webbrowser.open("http://127.0.0.1:9/")
""",
}
START = """
import os, sys
root, folder = sys.argv[1:]
sys.path.insert(0, root)
def program(*words):
    from oiiotex.oiiotool.cli.main import main
    main([f"{folder}/{word}" if word.endswith((".png", ".jpg", ".exr")) else word for word in words])
"""


def plant(folder: Path) -> Path:
    """Modules, and programs, named like those that are used; each notes that it has run."""
    mark = folder / "ran"
    for n, name in enumerate(MODULES):
        path = folder / name / "__init__.py" if n % 2 else folder / f"{name}.py"
        path.parent.mkdir(exist_ok=True)
        path.write_text(f"open({str(mark)!r}, 'a').write('module {name}' + chr(10))\nraise SystemExit(9)\n")
    (folder / "evil.pth").write_text(f"import sys; open({str(mark)!r}, 'a').write('evil.pth' + chr(10))\n")
    for name in PROGRAMS:
        path = folder / name
        path.write_text(f"#!/bin/sh\necho program {name} >> {shlex.quote(str(mark))}\nexit 9\n")
        path.chmod(0o755)
    return mark


@pytest.fixture
def planted(tmp_path):
    """A folder full of what must not run, and the environment that asks for it where lists of folders do."""
    (tmp_path / "here").mkdir()
    (tmp_path / "bin").mkdir()
    mark = plant(tmp_path / "here")
    with tempfile.TemporaryDirectory(prefix="oxi") as run:  # a short name: sockets' are
        Path(run).chmod(0o700)
        skipped = ("PYTHONSAFEPATH", "PYTHONPATH", "DISPLAY", "WAYLAND_DISPLAY", "BROWSER")
        environment = {name: value for name, value in os.environ.items() if name not in skipped} | {
            "PATH": os.pathsep.join((".", "", str(tmp_path / "bin"), os.environ["PATH"], ".")),
            "LIBRARY_PATH": ".", "COMPILER_PATH": ".", "OPENIMAGEIO_PLUGIN_PATH": ".", "BROWSER": "xdg-open",
            "XDG_RUNTIME_DIR": run, "POCL_CACHE_DIR": str(tmp_path / "kernels"),
        }  # fmt: skip
        yield tmp_path / "here", mark, environment


@pytest.mark.parametrize("way", WAYS)
def test_nothing_of_the_current_folder_is_run(tmp_path, planted, way):
    here, mark, environment = planted
    save(pictures.pebbles(32, 32, 1), tmp_path / "photo.png", space="srgb_rec709_scene")
    (tmp_path / "photos").mkdir()
    save(pictures.pebbles(16, 16, 1), tmp_path / "photos" / "m_diff.png")
    (tmp_path / "recipe.toml").write_text(RECIPE)
    line = [sys.executable, "-P", "-c", START + WAYS[way], str(ROOT), str(tmp_path)]
    done = subprocess.run(line, cwd=here, env=environment, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done
    assert not mark.exists(), mark.read_text()


def test_what_is_planted_does_run_where_nobody_takes_care(planted):
    here, mark, environment = planted
    for line in ([sys.executable, "-c", "import tornado"], ["sh", "-c", "sh"]):
        subprocess.run(line, cwd=here, env=environment, executable=None if "python" in line[0] else "/bin/sh")
    assert {"module tornado", "program sh"} <= set(mark.read_text().splitlines())


def test_lists_of_folders_lose_what_means_the_current_folder(monkeypatch):
    monkeypatch.setenv("PATH", ":/usr/bin:.:bin:/bin:")
    monkeypatch.setenv("LD_LIBRARY_PATH", ".")
    with start(["/usr/bin/env"], env=os.environ, stdout=subprocess.PIPE, text=True) as child:
        said = child.communicate()[0].splitlines()
    assert "PATH=/usr/bin:/bin" in said and not any(line.startswith("LD_LIBRARY_PATH=") for line in said)
    forget_current_folder()
    assert os.environ["PATH"] == "/usr/bin:/bin" and "LD_LIBRARY_PATH" not in os.environ
    with pytest.raises(ValueError, match="env: expected the absolute path"):
        start(["env"])


def test_lld_is_the_program_of_the_wheel():
    zig = runtime._zig()
    if zig is None:
        pytest.skip("no ziglang")
    text = Path(runtime._path_with_lld().split(os.pathsep)[0], "ld").read_text()
    assert f"exec {shlex.quote(str(zig))} ld.lld" in text and "python" not in text.replace(str(zig), "")
