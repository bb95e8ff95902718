# SPDX-License-Identifier: Apache-2.0
"""The plugin of hosts/openimageio in the wheel's own programs and in Python: levels and tiles, to the bit.

It is built once, in a quarter of a minute. Whatever reads through it is a process of its own.
"""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import shutil
import signal
import struct
import subprocess
import sys
import tempfile
import textwrap
import time
from collections.abc import Callable, Iterator
from importlib import metadata, util
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest

from oiiotex import filters
from oiiotex.oiiotool.service.client import connect
from oiiotex.oiiotool.service.texture_file import read_texture_file
from tests import pictures
from tests.conftest import save
from tests.hosts.builds import kept

HOST = Path(__file__).parents[2] / "hosts" / "openimageio"
BIN = Path(oiio.__file__).parent / "bin"
SPACE = "srgb_rec709_scene"
SIZE = 256  # px; the photo's 32 are level 5, so 256 are levels 5 to 0 and three that are flat
LAST = 5
Shell = Callable[..., subprocess.CompletedProcess]


def without_compiler() -> str:
    """What is missing to build it, in words; '' where nothing is."""
    for program in ("cmake", "c++"):
        if shutil.which(program) is None:
            return f"no {program}: apt install cmake g++ libfmt-dev libimath-dev nlohmann-json3-dev"
    for header in ("fmt/format.h", "Imath/half.h", "nlohmann/json.hpp"):
        line = ["c++", "-E", "-x", "c++", "-include", header, "-"]
        if subprocess.run(line, stdin=subprocess.DEVNULL, capture_output=True).returncode:
            return f"no header {header}: apt install libfmt-dev libimath-dev nlohmann-json3-dev"
    return "" if sys.platform == "linux" else "the plugin is for Linux"


@pytest.fixture(scope="session")
def plugin() -> Path:
    """The folder where it lies."""
    missing = without_compiler()
    if missing:
        pytest.skip(f"THE PLUGIN IS NOT BUILT: {missing}")
    version = metadata.version("OpenImageIO")
    shared = kept("openimageio_plugin", HOST, version, metadata.version("oiiotex"))
    with open(shared / "lock", "w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not (shared / "made").exists():
            spec = util.spec_from_file_location("build_plugin", HOST / "build.py")
            build = util.module_from_spec(spec)
            spec.loader.exec_module(build)
            try:
                source = build.source_of(version, shared)
            except subprocess.CalledProcessError as error:
                pytest.skip(f"THE PLUGIN IS NOT BUILT: no source of OpenImageIO: {error}")
            line = [sys.executable, str(HOST / "build.py"), "--into", str(shared), "--source", str(source)]
            built = subprocess.run([*line, "--work", str(shared / "work")], capture_output=True, text=True, timeout=300)
            assert built.returncode == 0, built.stdout + built.stderr
            assert "warning" not in built.stdout + built.stderr
            (shared / "made").touch()
    return shared / "lib" / "oiiotex"


@pytest.fixture(scope="module")
def folder() -> Iterator[Path]:
    """With a photo, a texture of it, and room for sockets: a short name, as theirs are."""
    with pytest.MonkeyPatch.context() as patch, contextlib.ExitStack() as stack:
        path = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="oxp")))
        (path / "run").mkdir(mode=0o700)
        patch.setenv("XDG_RUNTIME_DIR", str(path / "run"))
        save(pictures.stained(pictures.bricks(32, 40, seed=1)), path / "photo.png", space=SPACE)
        document(path / "wall.oiiotex")
        document(path / "long.oiiotex", size=f"{2**31 - 1024}x{2**17}")
        document(path / "huge.oiiotex", size=f"{2**20}x{2**20}")
        yield path
        resident(path).end()


def document(path: Path, **changes: object) -> None:
    facts = {"oiiotex": 1, "photo": "photo.png", "size": f"{SIZE}x{SIZE}", "seed": 3, "colorspace": SPACE}
    path.write_text(json.dumps(facts | changes))


def resident(folder: Path):
    """A client of the process that the plugin asks."""
    return connect(read_texture_file(str(folder / "wall.oiiotex")).settings())


@pytest.fixture(scope="module")
def shell(plugin: Path, folder: Path) -> Shell:
    """Runs a program with the plugin, in the folder."""

    def run(*words: object, **environment: str) -> subprocess.CompletedProcess:
        there = os.environ | {"OPENIMAGEIO_PLUGIN_PATH": str(plugin)} | environment
        line = list(map(str, words))
        return subprocess.run(
            line, cwd=folder, env=there, capture_output=True, text=True, errors="replace", timeout=120
        )

    return run


@pytest.fixture(scope="module")
def python(shell: Shell) -> Callable[[str], str]:
    """Runs lines of Python as a host; what they print."""

    def run(lines: str, **environment: str) -> str:
        start = "import OpenImageIO as oiio, numpy as np\n"
        done = shell(sys.executable, "-c", start + textwrap.dedent(lines), **environment)
        assert done.returncode == 0, done.stderr
        return done.stdout

    return run


def level(number: int, window: str, seed: int = 3) -> np.ndarray:
    """What --texsynth makes of a window of a level, 0 the finest."""
    photo = pictures.stained(pictures.bricks(32, 40, seed=1))
    bytes_ = np.rint(np.clip(photo, 0, 1) * 255).astype(np.uint8)
    made = filters.synth(bytes_, window=window, lod=max(0, LAST - number), seed=seed, colorspace=SPACE)
    return made.get_pixels(oiio.UINT8)


def test_oiiotool_cuts_out_of_it_what_the_program_makes(shell, folder):
    cut = shell(BIN / "oiiotool", "long.oiiotex?seed=7", "--cut", "100x64+2000000000+100000", "-o", "cut.png")
    assert cut.returncode == 0, cut.stdout + cut.stderr
    found = oiio.ImageBuf(str(folder / "cut.png")).get_pixels(oiio.UINT8)
    np.testing.assert_array_equal(found, level(0, "100x64+2000000000+100000", seed=7))
    told = shell(BIN / "oiiotool", "--info", "-v", "huge.oiiotex").stdout
    assert "1048576 x 1048576, 3 channel, uint8 oiiotexfile" in told and "tile size: 64 x 64" in told
    assert "524288x524288 262144x262144" in told and "2x2 1x1" in told and "oiiotex:seed: 3" in told


def test_attributes_of_oiiotex_are_still_written(shell):
    """OpenImageIO's writers drop attributes whose prefix is the name of another format."""
    done = shell(BIN / "oiiotool", "photo.png", "--attrib", "oiiotex:x", 3, "-o", "kept.exr")
    assert done.returncode == 0, done.stderr
    assert "oiiotex:x: 3" in shell(BIN / "oiiotool", "--info", "-v", "kept.exr").stdout


def test_every_level_is_one_of_texsynth(shell, folder):
    for number in (0, 2, 5):
        side = SIZE >> number
        made = shell(BIN / "oiiotool", "wall.oiiotex", "--selectmip", number, "-o", "level.png")
        assert made.returncode == 0, made.stdout + made.stderr
        found = oiio.ImageBuf(str(folder / "level.png")).get_pixels(oiio.UINT8)
        np.testing.assert_array_equal(found, level(number, f"{side}x{side}+0+0"))


def test_maketx_reads_it(shell, folder):
    made = shell(BIN / "maketx", "wall.oiiotex", "-o", "wall.tx")
    assert made.returncode == 0, made.stdout + made.stderr
    found = oiio.ImageBuf(str(folder / "wall.tx")).get_pixels(oiio.UINT8)
    np.testing.assert_array_equal(found, level(0, f"{SIZE}x{SIZE}+0+0"))


def test_a_plan_of_a_quilt_is_an_image(shell, folder):
    photo = oiio.ImageBuf(str(folder / "photo.png"))
    whole = filters.quilt(photo, size=(300, 130), patch=16, planfile=folder / "plan.npz", colorspace=SPACE)
    (folder / "quilt.oiiotex").write_text('{"oiiotex": 1, "photo": "photo.png", "plan": "plan.npz"}')
    made = shell(BIN / "oiiotool", "quilt.oiiotex", "-o", "quilt.png")
    assert made.returncode == 0, made.stdout + made.stderr
    found = oiio.ImageBuf(str(folder / "quilt.png")).get_pixels(oiio.UINT8)
    np.testing.assert_array_equal(found, whole.get_pixels(oiio.UINT8))


def test_eight_threads_of_a_cache_see_one_plane(python, folder):
    python("""
        from concurrent.futures import ThreadPoolExecutor
        cache = oiio.ImageCache()
        places = [(64 * x, 96 * y) for x in range(4) for y in range(4)]
        def read(place):
            x, y = place
            kind = oiio.TypeDesc("uint8")
            return cache.get_pixels("huge.oiiotex", 0, 1, 500000 + x, 500064 + x, y, y + 96, 0, 1, kind)
        with ThreadPoolExecutor(8) as threads:
            parts = dict(zip(places, threads.map(read, places)))
        whole = np.block([[[parts[64 * x, 96 * y]] for x in range(4)] for y in range(4)])
        np.save("threads.npy", whole)
    """)
    np.testing.assert_array_equal(np.load(folder / "threads.npy"), level(1, "256x384+500000+0"))


def test_lookups_between_levels_are_those_of_a_file_of_these_levels(python, folder):
    """Anisotropic and between levels, at seams of tiles: TextureSystem cannot tell it from an EXR."""
    photo = save(pictures.stained(pictures.bricks(32, 40, seed=1)), folder / "photo.exr", "half", SPACE)
    document(folder / "half.oiiotex", photo="photo.exr")
    output = oiio.ImageOutput.create("same.exr")
    for number in range(SIZE.bit_length()):
        side = SIZE >> number
        spec = oiio.ImageSpec(side, side, 3, "half")
        spec.tile_width = spec.tile_height = 64
        spec.attribute("wrapmodes", "black,black")
        spec.attribute("textureformat", "Plain Texture")
        made = filters.synth(
            oiio.ImageBuf(str(photo)), window=f"{side}x{side}+0+0" if number <= LAST else "1x1+0+0",
            lod=max(0, LAST - number), seed=3,
        ).get_pixels(oiio.HALF)  # fmt: skip
        assert output.open(str(folder / "same.exr"), spec, "AppendMIPLevel" if number else "Create")
        assert output.write_image(np.ascontiguousarray(np.broadcast_to(made, (side, side, 3)))), output.geterror()
    assert output.close(), output.geterror()
    del output  # which writes what is left of it
    said = python("""
        textures, options = oiio.TextureSystem(), oiio.TextureOpt()
        random, seen = np.random.default_rng(1), set()
        for _ in range(2000):
            s, t = random.integers(0, 9, 2) / 8 + random.normal(0, 0.02, 2)  # tiles of all levels end there
            across = 2.0 ** random.uniform(-9, 0, 2) * random.choice([-1, 1], 2)
            asked = (options, s, t, across[0], across[1] / 8, -across[1] / 4, across[0] / 64, 3)
            ours, theirs = (textures.texture(name, *asked) for name in ("half.oiiotex", "same.exr"))
            assert ours == theirs, (asked[1:], ours, theirs, textures.geterror())
            seen.add(ours)
        print(len(seen))
    """)
    assert int(said) > 1000


def test_one_that_is_killed_is_one_error_and_starts_again(python, shell, folder):
    said = python("""
        import os, signal
        from oiiotex.oiiotool.service.client import connect
        from oiiotex.oiiotool.service.texture_file import read_texture_file
        def pid():
            client = connect(read_texture_file("wall.oiiotex").settings())
            number = client.hello()["pid"]
            client.close()
            return number
        image = oiio.ImageInput.open("wall.oiiotex")
        before, first = image.read_tile(64, 0, 0, oiio.UINT8), pid()
        os.kill(first, signal.SIGKILL)
        assert image.read_tile(64, 0, 0, oiio.UINT8) is None
        print(image.geterror())
        np.testing.assert_array_equal(image.read_tile(64, 0, 0, oiio.UINT8), before)
        second = pid()
        assert second != first

        cache = oiio.ImageCache()  # which asks again where it is told to
        cache.attribute("failure_retries", 1)
        os.kill(second, signal.SIGKILL)
        again = cache.get_pixels("wall.oiiotex", 0, 0, 64, 128, 0, 64, 0, 1, oiio.TypeDesc("uint8"))
        np.testing.assert_array_equal(again, before)
    """)
    assert said == "oiiotex ERROR: the oiiotex process has ended; the next read starts another one\n"


def test_a_stale_socket_is_replaced(shell, folder):
    client = resident(folder)
    os.kill(client.hello()["pid"], signal.SIGKILL)
    path = read_texture_file(str(folder / "wall.oiiotex")).settings().socket()
    until = time.monotonic() + 20
    while not client.ended:
        assert time.monotonic() < until
        time.sleep(0.02)
    assert path.exists()
    done = shell(BIN / "oiiotool", "wall.oiiotex", "--cut", "8x8", "-o", "cut.png")
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.parametrize(
    ("content", "name", "text"),
    [
        ("{", "bad.oiiotex", "bad.oiiotex: not JSON"),
        (
            '{"oiiotex": 1, "photo": "photo.png", "size": "8x8"}',
            "bad.oiiotex?sed=7",
            "'?sed=7': expected seed",
        ),
        ('{"oiiotex": 1, "photo": "nowhere.png", "size": "8x8"}', "bad.oiiotex", "nowhere.png: No such file"),
        ('{"oiiotex": 1, "photo": "bad.oiiotex", "size": "8x8"}', "bad.oiiotex", "is already a texture"),
        ('{"oiiotex": 1, "photo": "photo.png", "colorspace": "no such", "size": "8x8"}', "bad.oiiotex", "no such"),
        ('{"oiiotex": 1, "photo": "/etc/hosts", "size": "8x8"}', "bad.oiiotex", "is outside the document's folder"),
        ("{", f"bad.oiiotex?seed={'9' * 9000}", "has 9005 characters: expected at most 1000"),
    ],
    ids=("json", "query", "none", "itself", "space", "outside", "long"),
)
def test_errors_are_one_line(shell, folder, content, name, text):
    (folder / "bad.oiiotex").write_text(content)
    done = shell(BIN / "oiiotool", name, "--cut", "8x8", "-o", "cut.png")
    said = [line for line in (done.stdout + done.stderr).splitlines() if "oiiotex ERROR: " in line]
    assert done.returncode != 0 and len(said) == 1 and text in said[0], done.stdout + done.stderr


def test_a_name_that_is_longer_than_a_command_line_is_said(shell):
    line = "import OpenImageIO as o; o.ImageInput.open('bad.oiiotex?seed=' + '9' * 200_000); print(o.geterror())"
    done = shell(sys.executable, "-c", line)  # oiiotool itself crashes
    assert "oiiotex ERROR: the file name is too long: expected at most 4096 characters" in done.stdout, done.stderr


def test_a_name_that_is_no_utf8_is_said(shell, folder):
    name = os.fsdecode(b"t\xfcr.oiiotex")
    shutil.copyfile(folder / "wall.oiiotex", folder / name)
    done = shell(BIN / "oiiotool", name, "--cut", "8x8", "-o", "cut.png")
    assert done.returncode != 0 and "oiiotex ERROR: the file name is not UTF-8" in done.stdout + done.stderr


def test_a_python_without_oiiotex_is_said(shell, folder):
    wrong = {
        "/bin/false": "/bin/false cannot start oiiotex",
        "/nowhere/python": "OIIOTEX_PYTHON",
        "python3": "OIIOTEX_PYTHON=python3: expected the absolute path",
    }
    for python, text in wrong.items():
        done = shell(BIN / "oiiotool", "wall.oiiotex", "--cut", "8x8", "-o", "cut.png", OIIOTEX_PYTHON=python)
        assert done.returncode != 0 and text in done.stdout + done.stderr


def message(text: str) -> bytes:
    return b"oxs\x01" + struct.pack("<I", len(text)) + text.encode()


SERVER = """
import os, socket, sys
os.umask(0)
path, answer, user = sys.argv[1], bytes.fromhex(sys.argv[2]), int(sys.argv[3])
listening = socket.socket(socket.AF_UNIX)
if user:
    os.setuid(user)
listening.bind(path)
listening.listen(4)
print("listening", flush=True)
while True:
    connection = listening.accept()[0]
    connection.recv(1 << 16)
    connection.sendall(answer)
"""


@pytest.mark.parametrize(
    ("answer", "user", "text"),
    [
        (b"oxs\x02\2\0\0\0{}", 0, "has another version: rebuild the plugin"),
        (b"oxs\x01\xff\xff\xff\xff", 0, "has another version"),
        (message("{]"), 0, "invalid message from"),
        (message('{"state": "done", "arrays": []}'), 0, "invalid message from"),
        (message('{"state": "done", "arrays": [1]}'), 0, "lacks its pixels"),
        (message('{"state": "failed", "arrays": [], "text": "a \\u20ac b"}'), 0, "a € b"),
        (b"", 65534, "belongs to another user"),
    ],
)
def test_a_stranger_behind_the_socket_is_not_believed(shell, folder, tmp_path, answer, user, text):
    if user and os.geteuid():
        pytest.skip("only root can be another user")
    with tempfile.TemporaryDirectory(prefix="oxq") as place:
        os.chmod(place, 0o777)
        path, door = Path(place, "s"), tmp_path / "door"
        door.write_text(f"#!/bin/sh\necho '{json.dumps({'socket': str(path), 'texture': 'x'})}'\n")
        door.chmod(0o755)
        line = [sys.executable, "-c", SERVER, str(path), answer.hex(), str(user)]
        with subprocess.Popen(line, stdout=subprocess.PIPE) as server:
            try:
                assert server.stdout.readline() == b"listening\n"
                done = shell(
                    BIN / "oiiotool", "wall.oiiotex", "--cut", "8x8", "-o", "cut.png", OIIOTEX_PYTHON=str(door)
                )
            finally:
                server.kill()
        said = [one for one in (done.stdout + done.stderr).splitlines() if "oiiotex ERROR: " in one]
        assert done.returncode == 1 and len(said) == 1 and text in said[0], done.stdout + done.stderr


def test_a_host_with_another_openimageio_is_told_once(shell, plugin, tmp_path):
    shutil.copy(plugin / "oiiotexfile.imageio.so", tmp_path)  # without its reader, as for another version
    done = shell(BIN / "oiiotool", "wall.oiiotex", "-o", "cut.png", OPENIMAGEIO_PLUGIN_PATH=str(tmp_path))
    said = [one for one in (done.stdout + done.stderr).splitlines() if one.startswith("oiiotex ERROR: ")]
    assert done.returncode == 1 and len(said) == 1, done.stderr
    assert f"built for OpenImageIO {metadata.version('OpenImageIO')}, which this program does not have" in said[0]


PROGRAM = "import sys; sys.prefix = sys.argv[1]; from oiiotex.oiiotool.cli.main import main; main(['--plugin-path'])"


def test_the_program_says_where_it_lies(plugin):
    done = subprocess.run([sys.executable, "-c", PROGRAM, plugin.parents[1]], capture_output=True, text=True)
    assert (done.stdout, done.returncode) == (f"{plugin}\n", 0)


def test_the_program_says_how_it_is_built(tmp_path):
    done = subprocess.run([sys.executable, "-c", PROGRAM, tmp_path], capture_output=True, text=True)
    assert done.returncode == 1 and done.stdout == ""
    assert done.stderr.startswith("oiiotex ERROR: --plugin-path: ") and "hosts/openimageio/build.py" in done.stderr
    assert done.stderr.count("\n") == 1
