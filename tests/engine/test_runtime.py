# SPDX-License-Identifier: Apache-2.0
"""Which device is used and how: the order of attempts, what is kept, what is named to PoCL."""

from __future__ import annotations

import ctypes
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from oiiotex.engine.errors import DeviceError, NoDeviceError
from oiiotex.engine.opencl import cpu as opencl_cpu
from oiiotex.engine.opencl import device_choice as devices
from oiiotex.engine.opencl import probe, runtime
from oiiotex.engine.opencl.device import Device, DeviceInfo
from oiiotex.engine.opencl.runtime import Attempt, Trial
from oiiotex.oiiotool.cli.printing.devices import device_list
from tests.conftest import oiiotex

CPU = 1 << 1  # CL_DEVICE_TYPE_CPU
GENERIC = "OpenCL 3.0 PoCL HSTR: pthread-x86_64-unknown-linux-gnu-generic"
REFUSED = "error: unknown target CPU 'generic'"
ZEN = opencl_cpu.KNOWN["znver3"]


def handle(number: int, version: str = GENERIC, platform: str = opencl_cpu._POCL_3_0, kind: int = CPU) -> object:
    """What a runtime says of a device."""
    return SimpleNamespace(
        int_ptr=number, name=f"device {number}", version=version, driver_version="1", type=kind,
        single_fp_config=191, max_mem_alloc_size=1 << 30, platform=SimpleNamespace(name="a runtime", version=platform),
    )  # fmt: skip


@pytest.fixture
def machine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> SimpleNamespace:
    """A machine whose probes are ours: `works` says what each finds, `asked` notes all; `forget` is a new process."""
    made = SimpleNamespace(asked=[], works=lambda device, attempt: 0, forget=lambda: None)

    def stand_in(device: object, attempt: Attempt) -> tuple[int, str]:
        made.asked.append((device.name, attempt.linker, attempt.cpu))
        lanes = made.works(device, attempt)
        return lanes, "" if lanes else REFUSED

    def forget() -> None:
        made.asked.clear()
        runtime._trials.clear()
        devices._say.cache_clear()

    made.forget = forget
    monkeypatch.setattr(runtime, "_try_in_subprocess", stand_in)
    monkeypatch.setattr(runtime, "cache_folder", lambda: tmp_path)
    monkeypatch.setattr(runtime, "_zig", lambda: Path("/zig"))
    monkeypatch.setattr(runtime, "_trials", {})
    monkeypatch.setattr(opencl_cpu, "cpu", lambda: {"flags": " ".join(ZEN), "model": "26"})
    monkeypatch.setattr(devices, "_refused", set())
    monkeypatch.delenv("OIIOTEX_DEVICE", raising=False)
    devices._say.cache_clear()
    return made


def with_devices(monkeypatch: pytest.MonkeyPatch, *kinds: str) -> list[DeviceInfo]:
    listed = [
        DeviceInfo(
            n, kind, f"device {n}", f"runtime {n}", GENERIC, 1 << 30, handle(n, kind=CPU if kind == "cpu" else 4)
        )
        for n, kind in enumerate(kinds)
    ]
    monkeypatch.setattr(devices, "devices", lambda threads=0: listed)
    monkeypatch.setattr(runtime, "use", lambda device: None)
    return listed


def test_attempts_come_in_order_until_a_kernel_counts_right(machine):
    order = [("system", ""), ("lld", ""), ("system", "znver3"), ("lld", "znver3")]
    for first in range(4):
        machine.works = lambda device, attempt, at=order[first]: 16 * ((attempt.linker, attempt.cpu) == at)
        machine.forget()
        for answer in runtime.cache_folder().glob("*.json"):
            answer.unlink()
        trial = runtime.tried(handle(1))
        assert [a[1:] for a in machine.asked] == order[: first + 1]
        assert (trial.works, trial.lanes) == (Attempt(*order[first]), 16)
        assert trial.failures == tuple((Attempt(*words), REFUSED) for words in order[:first])


def test_a_cpu_is_named_to_that_pocl_alone_and_only_where_it_knows_none(machine, monkeypatch):
    named = ["", "", "znver3", "znver3"]
    other = opencl_cpu._POCL_3_0.replace("3.0-rc2", "3.1")
    cases = [
        (handle(1), named),
        (handle(2, version=GENERIC.replace("generic", "znver3")), ["", ""]),
        (handle(3, platform=other), ["", ""]),
        (handle(4, kind=4), [""]),  # a GPU brings its own compiler
    ]
    for device, expected in cases:
        machine.forget()
        assert runtime.tried(device).works is None
        assert [cpu for _, _, cpu in machine.asked] == expected
    monkeypatch.setattr(runtime, "_zig", lambda: None)
    machine.forget()
    runtime.tried(handle(1))
    assert [a[1:] for a in machine.asked] == [("system", ""), ("system", "znver3")]


def test_what_works_is_kept_until_the_cpu_is_another(machine, monkeypatch):
    machine.works = lambda device, attempt: 32 * bool(attempt.cpu)
    first = runtime.tried(handle(1))
    machine.forget()
    assert runtime.tried(handle(1)) == first and not machine.asked
    for facts in ({"flags": "sse2"}, {"model": "27"}, {"vendor_id": "GenuineIntel"}):
        monkeypatch.setattr(opencl_cpu, "cpu", lambda facts=facts: {"flags": " ".join(ZEN), "model": "26", **facts})
        machine.forget()
        runtime.tried(handle(1))
        assert machine.asked
    for answer in runtime.cache_folder().glob("probe-*.json"):
        answer.write_text('{"works": 7}')
    machine.forget()
    assert runtime.tried(handle(1)).works and machine.asked  # what is not ours is not believed


def test_a_failure_is_kept_only_where_another_device_works(machine, monkeypatch, caplog):
    one, two = with_devices(monkeypatch, "cpu", "cpu")
    with pytest.raises(NoDeviceError, match=r"no OpenCL device can compile: .*unknown target CPU 'generic'.*pip|apt"):
        devices.choose()
    assert not list(runtime.cache_folder().glob("*.json"))
    machine.works = lambda device, attempt: 16 * (device.name == "device 1")
    for _ in range(2):
        machine.forget()
        caplog.clear()
        assert devices.choose() == two
        assert len(caplog.messages) == 1 and REFUSED in caplog.text and "using device 1 instead" in caplog.text
    assert not machine.asked  # the second process believes the first
    machine.forget()
    listing = device_list(None, 1, verbose=True)
    assert [name for name, *_ in machine.asked] == ["device 0"] * 4  # a list looks again
    assert "device 0 (cpu), runtime 0" in listing and "does not work" in listing.splitlines()[0]
    assert "CPU set to znver3, LLD: " + REFUSED in listing


def test_a_device_that_is_named_is_not_replaced_and_a_kind_means_all_of_it(machine, monkeypatch):
    gpu, broken, works = with_devices(monkeypatch, "gpu", "cpu", "cpu")
    machine.works = lambda device, attempt: 16 * (device.name != "device 1")
    assert devices.choose() == gpu
    assert devices.choose("cpu") == works
    with pytest.raises(NoDeviceError, match="device 1"):
        devices.choose("1")
    monkeypatch.setenv("OIIOTEX_DEVICE", "device 1")
    with pytest.raises(NoDeviceError, match="device 1"):
        devices.choose()


def test_lanes_follow_what_is_compiled_for(machine, monkeypatch):
    (info,) = with_devices(monkeypatch, "cpu")
    monkeypatch.setattr(opencl_cpu, "cpu", lambda: {"flags": " ".join(ZEN | {"avx512bw"})})
    for lanes in (16, 32):
        machine.works = lambda device, attempt, lanes=lanes: lanes
        machine.forget()
        for answer in runtime.cache_folder().glob("*.json"):
            answer.unlink()
        assert Device.lanes.fget(SimpleNamespace(info=info)) == lanes


def test_a_device_that_ends_long_loops_does_not_work(device, monkeypatch):
    assert probe._lanes(device.info.handle) > 0
    monkeypatch.setattr(probe, "_SOURCE", probe._SOURCE.replace("k < loops", "k < min(loops, 65535)"))
    with pytest.raises(ArithmeticError, match="a loop of 100000 iterations ends early"):
        probe._lanes(device.info.handle)


def test_the_list_says_what_is_used_and_what_is_promised(machine, monkeypatch):
    info, _ = with_devices(monkeypatch, "cpu", "other")
    machine.works = lambda device, attempt: 16 * bool(attempt.cpu)
    listing = device_list(None, 3, verbose=True)
    for words in (
        "selected: first working CPU; no GPU works", f"default settings, LLD: {REFUSED}",
        "CPU set to znver3, system linker: works", "compiles for znver3: 16 lanes",
        "threads: 3", "memory: 1024 MB, largest allocation 1024 MB",
        "division and square root: rounded correctly", "not tested",
    ):  # fmt: skip
        assert words in listing
    info.handle.single_fp_config = 7
    assert "rounding unknown; results may differ between devices" in device_list(None, 3, verbose=True)
    machine.works = lambda device, attempt: 0
    machine.forget()
    for answer in runtime.cache_folder().glob("*.json"):
        answer.unlink()
    lines = device_list(None, 1, verbose=False).splitlines()
    assert lines[0].endswith("does not work") and lines[2].startswith("no OpenCL device works: ")


@pytest.mark.parametrize("linker, intel, zig, expected", [
    (False, False, True, "pip install 'oiiotex[intel]'"),
    (True, False, False, "pip install 'oiiotex[linker]'"),
    (True, False, True, "pip install 'oiiotex[intel]'"),
    (False, True, True, "apt install pocl-opencl-icd"),
])  # fmt: skip
def test_one_command_helps(monkeypatch, linker, intel, zig, expected):
    monkeypatch.setattr(runtime, "_intel_library", lambda: Path("/x") if intel else None)
    monkeypatch.setattr(runtime, "_zig", lambda: Path("/zig") if zig else None)
    monkeypatch.setattr(runtime, "program", lambda name: name)
    monkeypatch.setattr(runtime.platform, "machine", lambda: "x86_64")
    monkeypatch.setattr(runtime.sys, "platform", "linux")
    words = """error: unable to execute command: Executable "ld" doesn't exist! (SIGABRT)""" if linker else REFUSED
    assert runtime.remedy([Trial(None, 0, ((Attempt(), words),))]) == expected
    monkeypatch.setattr(runtime.platform, "machine", lambda: "aarch64")
    assert runtime.remedy([]) == "apt install pocl-opencl-icd"


def test_the_best_cpu_that_this_one_covers():
    best = opencl_cpu.best_known
    known = opencl_cpu.KNOWN
    assert best(known["znver3"] | known["icelake-server"]) == "znver3"  # measured: no slower than icelake-server there
    assert best(known["icelake-server"]) == "icelake-server"
    assert best(known["icelake-server"] - {"gfni"}) == "skylake-avx512"
    assert best(known["skylake-avx512"] - {"avx512bw"}) == "haswell"
    assert best(known["haswell"] - {"avx2"}) == "x86-64-v2"
    assert best(known["x86-64-v2"] - {"popcnt"}) == best([]) == "x86-64"
    for name in known:
        assert best(known[name]) == name, "a CPU that an earlier one of the table hides"


class Struct:
    """PoCL's of a device: words of memory, one of them a pointer to a text."""

    def __init__(self, text: bytes):
        self.text = ctypes.create_string_buffer(text)
        self.words = (ctypes.c_uint64 * 256)(*range(256))  # small numbers: not mapped
        self.words[80] = ctypes.addressof(self.text)

    @property
    def address(self) -> int:
        return ctypes.addressof(self.words)


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads /proc")
def test_the_name_is_changed_in_the_wheels_build_alone(monkeypatch):
    struct = Struct(b"generic")
    with monkeypatch.context() as patch:
        patch.setattr(opencl_cpu, "_LIBRARY_BYTES", 1)
        with pytest.raises(LookupError, match=r"PoCL 3\.0"):
            opencl_cpu.name_cpu(handle(struct.address), "znver2")
    monkeypatch.setattr(opencl_cpu, "_wheels_library_is_loaded", lambda: True)
    with pytest.raises(LookupError, match=r"PoCL 3\.0"):
        opencl_cpu.name_cpu(handle(struct.address, platform="OpenCL 3.0 PoCL 3.0"), "znver2")
    opencl_cpu.name_cpu(handle(struct.address), "znver2")
    assert ctypes.string_at(struct.words[80]) == b"znver2"
    assert struct.text.value == b"generic"  # PoCL's own text may be shared: it is left as it is
    for text in (b"znver3", b"generically"):
        with pytest.raises(LookupError, match="no CPU name at the expected address"):
            opencl_cpu.name_cpu(handle((other := Struct(text)).address), "znver2")
        assert other.words[80] == ctypes.addressof(other.text)
    with pytest.raises(LookupError, match="not at the expected address"):
        opencl_cpu.name_cpu(handle(4096), "znver2")  # nothing is mapped there


def test_the_wheels_library_is_known_in_a_folder_with_spaces(monkeypatch, tmp_path):
    library = tmp_path / "a b" / opencl_cpu._LIBRARY
    library.parent.mkdir()
    library.write_bytes(b"12345")
    monkeypatch.setattr(opencl_cpu, "_LIBRARY_BYTES", 5)
    monkeypatch.setattr(opencl_cpu, "_maps", lambda: [f"7f0000-7f1000 r-xp 00000000 08:01 123    {library}"])
    assert opencl_cpu._wheels_library_is_loaded()
    monkeypatch.setattr(opencl_cpu, "_LIBRARY_BYTES", 6)
    assert not opencl_cpu._wheels_library_is_loaded()


def test_words_of_a_compiler_without_its_options():
    said = (
        "clBuildProgram failed: BUILD_PROGRAM_FAILURE - clBuildProgram failed\n\nBuild on <pyopencl.Device 'x'>:\n\n"
        "warning: argument unused\nerror: a.cl:3:1: expected ';'\n1 error generated.\n\n(options: -I /secret)\n(source)"
    )
    assert runtime.compilers_words(said) == "error: a.cl:3:1: expected ';'"
    assert runtime.compilers_words("clBuildProgram failed: NOT_NOW (options: -I /secret)") == (
        "clBuildProgram failed: NOT_NOW"
    )


def test_a_refused_device_is_chosen_no_more(machine, monkeypatch):
    one, two = with_devices(monkeypatch, "gpu", "cpu")
    machine.works = lambda device, attempt: 1
    assert devices.choose() == one
    assert devices.refuse(one) == two
    assert devices.choose() == two
    assert devices.choose("0") == one  # by name it is
    assert devices.refuse(two) is None


def test_the_list_of_devices_names_one_that_works():
    listing = oiiotex("--devices", "-v").stdout
    assert "works\n" in listing and "selected: " in listing
    assert devices.choose().name in listing


def test_devices_of_a_name_that_nobody_has():
    with pytest.raises(DeviceError, match="no device 'abacus'"):
        devices.choose("abacus")


# --- make ---


def test_make_takes_the_step_that_helps(monkeypatch, capsys):
    from tools import device as make

    def nothing() -> None:
        raise NoDeviceError("no OpenCL device can compile", "pip install 'oiiotex[intel]'")

    class Replaced(Exception):
        pass

    def execv(program: str, words: list[str]) -> None:
        raise Replaced(words)

    ran = []
    monkeypatch.setattr(make.device_choice, "choose", nothing)
    monkeypatch.setattr(make.subprocess, "run", lambda command, check: ran.append(command))
    monkeypatch.setattr(make.os, "execv", execv)
    monkeypatch.setattr(sys, "argv", ["tools.device"])
    with pytest.raises(Replaced) as again:
        make.main()
    assert ran[0][1:5] == ["-m", "pip", "install", "-q"] and ran[0][-1].endswith("[intel]")
    assert "make now runs: " in capsys.readouterr().out
    monkeypatch.setattr(sys, "argv", again.value.args[0][2:])
    with pytest.raises(SystemExit, match="pip install"):  # it did not help: not once more
        make.main()
    assert len(ran) == 1
    assert make.step("apt install x")[:1] in ([], ["apt-get"])
    assert make.step("") == []
