# SPDX-License-Identifier: Apache-2.0
"""Devices with less memory than they say, or than the host has: smaller pieces, the same bits, or one clear line."""

from __future__ import annotations

import gc
import logging
from types import SimpleNamespace

import numpy as np
import OpenImageIO as oiio
import pytest

from oiiotex import filters
from oiiotex.engine.color.lab import lens_of
from oiiotex.engine.color.lab_on_device import LabGrid
from oiiotex.engine.core.window import Window
from oiiotex.engine.errors import DeviceError, MemoryBudgetError, OutOfDeviceMemory
from oiiotex.engine.opencl import buffers
from oiiotex.engine.opencl import device_choice as devices
from oiiotex.engine.opencl.buffers import Buffers, in_smaller_pieces, offset_table
from oiiotex.engine.opencl.device import Device
from oiiotex.engine.session import Session
from oiiotex.synthesis.multiscale import candidate_sets
from oiiotex.synthesis.patchmatch import memory
from oiiotex.synthesis.patchmatch.constraints import Constraints
from oiiotex.synthesis.patchmatch.recipe import Recipe, geometry_at
from tests import pictures
from tests.analysis.test_superpixels import image_of, resources_of
from tests.refusals import refused

PHOTO = pictures.stained(pictures.pebbles(48, 56, seed=4))
RUNS = {
    "stationarize": {"size": (36, 32), "iterations": 2, "seed": 1},
    "quilt": {"size": (70, 64), "seed": 1},
    "synth": {"size": (40, 24), "seed": 1},
    "superpixel": {"sigmamin": 8.0},
    "label": {},
}


class Scarce(Device):
    """A device whose `fails(self)` says of each command and allocation whether there is no memory for it."""

    def __init__(self):
        super().__init__(devices.choose())
        self._cl = _Counting(self, self._cl)
        self.failing()

    def failing(self, fails=lambda self: False) -> Scarce:
        """The same device, from now on with that rule; kernels stay built."""
        self.count, self._fails = 0, fails
        return self

    def command(self) -> None:
        self.count += 1
        if self._fails(self):
            raise self._cl.MemoryError("failed: MEM_OBJECT_ALLOCATION_FAILURE")

    def _enqueue(self, name, command, *arguments, **options):
        def counted(*arguments, **options):
            self.command()
            return command(*arguments, **options)

        return super()._enqueue(name, counted, *arguments, **options)


class _Counting:
    """pyopencl, whose buffers are counted with the commands."""

    def __init__(self, device: Scarce, cl):
        self._device, self._module = device, cl

    def __getattr__(self, name):
        return getattr(self._module, name)

    def Buffer(self, *arguments, **options):
        self._device.command()
        return self._module.Buffer(*arguments, **options)


@pytest.fixture(scope="module")
def scarce() -> Scarce:
    return Scarce()


@pytest.fixture
def run(scarce, tmp_path, monkeypatch):
    """The pixels that a filter makes on the device; the analysis of exemplars is made anew each time."""
    photo = oiio.ImageBuf(oiio.ImageSpec(PHOTO.shape[1], PHOTO.shape[0], 3, oiio.FLOAT))
    photo.specmod().attribute("oiio:ColorSpace", "srgb_rec709_scene")
    photo.set_pixels(photo.roi, PHOTO.astype(np.float32))

    def made(name: str, folder: int) -> np.ndarray:
        monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / str(folder)))
        session = Session()
        session.resources.device = scarce
        result = getattr(filters, name)(photo, session=session, **RUNS[name])
        result = next(iter(result.values())) if isinstance(result, dict) else result
        return result.get_pixels(result.spec().format)

    return made


def swept(run, scarce: Scarce, name: str, points: int) -> None:
    """A run of which one command after another finds no memory, once: the same bits, or one line."""
    scarce.failing()
    wanted, went_on = run(name, 0), 0
    for n in sorted(set(np.linspace(1, scarce.count, points).round().astype(int).tolist())):
        gc.collect()
        before = scarce.taken
        scarce.failing(lambda self, n=n: self.count == n)
        try:
            np.testing.assert_array_equal(run(name, n), wanted)
            went_on += 1
            continue
        except DeviceError as error:
            assert "\n" not in str(error)
            assert " MB" in str(error), error
        gc.collect()
        assert scarce.taken <= before, f"command {n}: {scarce.taken} bytes are kept"
    assert bool(went_on) == (name != "stationarize")  # this one has no pieces


@pytest.mark.parametrize("name", RUNS)
def test_a_command_that_finds_no_memory_is_no_internal_error(run, scarce, name):
    swept(run, scarce, name, 2)


@pytest.mark.slow
@pytest.mark.parametrize("name", RUNS)
def test_no_command_that_finds_no_memory_is_an_internal_error(run, scarce, name):
    swept(run, scarce, name, 8)


def test_lent_memory_is_kept_until_no_command_is_queued():
    """After an error, kernels may still read tables of the host that nobody else holds."""
    device, table = Device(devices.choose()), np.zeros(1 << 22, np.int32)
    with Buffers(device, {"much": 1 << 26}, 1 << 28, "a test", tables={"table": table}) as held:
        for n in range(50):
            device.fill(held["much"], np.int32(n), 1 << 24)
        event = device.mark()
    assert event.command_execution_status == device._cl.command_execution_status.COMPLETE


def test_an_image_lies_on_a_device_in_smaller_pieces_until_they_fit():
    """A device that gives less than it says, whenever it is asked."""
    image = image_of(pictures.pebbles(300, 96, seed=3))
    scarce, whole = Scarce(), 8 * 300 * 96

    def found(device):
        return filters_superpixels(image, resources_of(device))

    wanted = found(scarce.failing())
    np.testing.assert_array_equal(found(scarce.failing(lambda self: self.taken > whole)), wanted)
    assert scarce.taken == 0
    with pytest.raises(OutOfDeviceMemory, match=r"the image in squares: .* could not allocate 1 MB"):
        found(scarce.failing(lambda self: self.taken > 1000))


def filters_superpixels(image, resources):
    from oiiotex.analysis.superpixels.superpixels import superpixels

    found = superpixels(image, lens_of(image, resources), resources, sigma=40.0, iterations=3)
    return found.runs.pixels(0, 300, 0, 96)


def gpu(memory: int, largest: int) -> Device:
    """The CPU seen as a device with memory of its own."""
    device = Device(devices.choose())
    device.own_memory, device.memory, device.largest = True, memory, largest
    return device


@pytest.mark.parametrize(
    ("memory", "largest", "budget", "resident"),
    [
        (8 << 20, 8 << 20, 64 << 30, True),
        (800 << 10, 800 << 10, 64 << 30, False),  # less memory than the host has
        (8 << 20, 200 << 10, 64 << 30, False),  # no buffer is so large
        (8 << 20, 8 << 20, 1 << 20, True),  # the host's budget is another's
    ],
)
def test_an_image_stays_on_a_device_that_has_the_memory_for_it(memory, largest, budget, resident):
    image = image_of(pictures.pebbles(300, 96, seed=3))  # 230 KB in Lab
    device = gpu(memory, largest)
    resources = resources_of(device, budget=budget)
    with LabGrid(image, lens_of(image, resources), resources, 16) as lab:
        assert lab.resident == resident
        most = min(memory, largest)
        assert all(8 * lab.width * (band.bottom - band.top) < most for band in lab.bands())
        assert device.taken <= most
    assert device.taken == 0
    found = filters_superpixels(image, resources)
    np.testing.assert_array_equal(found, filters_superpixels(image, resources_of(devices.open_device())))


def test_budgets_of_host_and_device_are_two_figures():
    with pytest.raises(DeviceError, match=r"test .*9 MB; .*7 MB"):
        Buffers(gpu(8 << 20, 9 << 20), {"a": 9 << 20}, 64 << 30, "a test")
    device = gpu(8 << 20, 8 << 20)
    with Buffers(device, {"a": 3 << 20}, 1 << 20, "a test"):  # the host's budget is smaller
        assert device.taken == 3 << 20
        with pytest.raises(DeviceError, match=r"test .*5 MB; .*4 MB"):
            Buffers(device, {"a": 5 << 20}, 1 << 20, "a test")
    assert device.taken == 0
    with refused(MemoryBudgetError, task="a test", budget=1 << 20):
        Buffers(device, {"a": 1}, 1 << 20, "a test", held=2 << 20)
    assert device.memory_budget(1 << 20) == 7 << 20
    shared = devices.open_device()
    assert shared.memory_budget(1 << 20) == 1 << 20
    assert shared.memory_budget(1 << 60) == shared.memory


@pytest.mark.parametrize(("measure", "gigabytes"), [("histogram", 24), ("moments", 11)])
def test_a_small_sigma_over_a_large_tile_is_held_in_bands(device, measure, gigabytes):
    """sigma=2 at 4096 x 4096: a cell to a pixel; two grids of 64 bins, or sums of powers and copies of them."""
    recipe = Recipe(
        width=4096, height=4096, wrap_x=True, wrap_y=True, sigma=2.0, patch=11, iterations=8, seed=0, uniformity=0.01,
        contrast=0.7, flat=True, measure=measure,
    )  # fmt: skip
    shape = 1024, 1024, 3
    geometries, scales = [geometry_at(recipe, shape, 1.0)], [1.0]
    whole = memory.layout(recipe, geometries, memory.grids_of(recipe, geometries, scales, Constraints()), Constraints())
    assert sum(whole.values()) >> 30 == gigabytes

    def planned(budget: int) -> memory.MemoryPlan:
        return memory.plan_memory(
            device, shape, recipe, geometries, scales, Constraints(), budget, memory.ExemplarHeld()
        )

    small, large = planned(600 << 20), planned(3 << 30)
    for plan, budget in ((small, 600 << 20), (large, 3 << 30)):
        assert sum(plan.layout.values()) + plan.on_host <= budget
    assert small.layout["field"] < large.layout["field"] == 4 * 4096**2  # then the tile's own rows are not banded
    with refused(MemoryBudgetError, task="a tile", budget=64 << 20):
        Buffers(device, planned(64 << 20).layout, 64 << 20, "a tile")


def test_what_takes_much_says_it(caplog, monkeypatch, device):
    monkeypatch.setattr(buffers, "_WORTH_SAYING", 1 << 20)
    caplog.set_level(logging.INFO, "oiiotex")
    with Buffers(device, {"a": 3 << 20}, 1 << 30, "a tile"):
        assert f"a tile uses 3 MB of {device.info.name}" in caplog.text


def test_what_does_not_fit_an_int_is_an_error_and_does_not_wrap(device):
    run = device.program("patchmatch", PATCH=11, CHANNELS=3, LATTICE=0, PIECES=0)
    for shape, numbers in (((8, 1 << 31), (8, 8)), ((8, 8), (8, 1 << 31)), ((8, 8), (8, -(1 << 31) - 1))):
        with pytest.raises(DeviceError, match=r"patchmatch_hold .*-?2147483\d+.* 2\^31"):
            run("hold", shape, None, None, *numbers)
    assert offset_table(np.array([0, (1 << 31) - 1])).dtype == np.int32
    with pytest.raises(DeviceError, match=r"table .*2147483648"):
        offset_table(np.array([0, 1 << 31]))


@pytest.mark.parametrize("code", [-4, -5, -6])
def test_whatever_says_that_memory_is_missing_is_known(scarce, code):
    device = scarce.failing()
    cl = device._cl

    def failing(*_):
        raise cl.RuntimeError(cl._cl._ErrorRecord("", code, "clEnqueueNDRangeKernel"))

    with pytest.raises(OutOfDeviceMemory, match="ran out of memory in a test"):
        device._enqueue("a test", failing)
    code = -52  # a fault of ours stays one
    with pytest.raises(cl.RuntimeError):
        device._enqueue("a test", failing)


def test_more_texels_than_can_be_named_are_refused(device):
    many = np.broadcast_to(np.True_, (2049, 1024, 1024))
    with pytest.raises(DeviceError, match=r"2148532224 texels.* 2\^31"):
        candidate_sets.analyze(device, candidate_sets.Stacks(None, many, many, many, ()), 16, True, 1, None, None)


def test_smaller_pieces_end_at_the_least():
    tried = []

    def work(size):
        tried.append(size)
        raise OutOfDeviceMemory("no 5 MB")

    with pytest.raises(OutOfDeviceMemory, match="no 5 MB"):
        in_smaller_pieces(work, 100, 20)
    assert tried == [100, 50, 25, 20]
    assert in_smaller_pieces(lambda size: size, 3, 5) == 3


def test_a_window_of_a_plane_is_made_in_smaller_ones(monkeypatch):
    from oiiotex.synthesis.multiscale import synthesizer

    asked = []

    class Maker(synthesizer.Synthesizer):
        def __init__(self):
            self._settings, self._turn = synthesizer.PlaneSettings(), synthesizer.threading.RLock()
            self._free, self._moves = [], True

        def _begun(self, levels, window):
            asked.append(window)
            if window.width * window.height > 5000:
                raise OutOfDeviceMemory("no 5 MB")
            y, x = np.mgrid[window.top : window.bottom, window.left : window.right]
            state = synthesizer.PlaneState(
                (x + 1000 * y).astype(np.uint32), np.stack([x, y, x, y], -1).astype(np.int16)
            )
            return SimpleNamespace(state=lambda: state)

    window = Window(7, 3, 207, 83)
    texel, offset = Maker().window(0, window)
    y, x = np.mgrid[3:83, 7:207]
    np.testing.assert_array_equal(texel, x + 1000 * y)
    np.testing.assert_array_equal(offset[..., 1], y)
    assert asked[0] == window
    assert 16 <= max(w.width for w in asked[-3:]) <= 64
