# SPDX-License-Identifier: Apache-2.0
"""Kernels through the compilers of GPU drivers: none spills, all reach a quarter of a GPU's occupancy."""

from __future__ import annotations

import pytest

from benchmarks.gpu import paper

BOTH = [paper.GPUS[0], paper.GPUS[-1]]
REASONS = {"histograms_values": "16 KB of local memory hold the histogram of a group"}


def faults(gpu: paper.Gpu, every: bool) -> list[str]:
    """A line for each kernel that a driver would run badly."""
    if absent := paper.missing(gpu):
        pytest.skip(f"NOTHING COMPILED FOR {gpu.name}: not installed: {absent}")
    found = []
    for name, row in paper.survey((gpu,), every).items():
        kernel = row[gpu.name]
        if kernel.spilled:
            found.append(f"{name}: {kernel.spilled} spills")
        if kernel.occupancy < paper.LEAST and name not in REASONS:
            found.append(f"{name}: occupancy {kernel.occupancy:.2f}")
    return found


@pytest.mark.parametrize("gpu", BOTH, ids=lambda gpu: gpu.name)
def test_no_kernel_spills_or_starves(gpu):
    assert not faults(gpu, every=False)


@pytest.mark.slow
@pytest.mark.parametrize("gpu", paper.GPUS, ids=lambda gpu: gpu.name)
def test_with_every_set_of_options(gpu):
    """Of the first and the last; of those between the usual one."""
    assert not faults(gpu, every=gpu in BOTH)


def test_a_kernel_that_spills_is_found(tmp_path, monkeypatch):
    """280 values of which the first meets the last: all are alive at once, an item has 255 registers."""
    values = "".join(f"float v{n} = a[{n}];\n" for n in range(280))
    total = " + ".join(f"v{n} * v{279 - n}" for n in range(140))
    source = f"__kernel void greedy_one(volatile __global float *a) {{\n{values}a[0] = {total};\n}}\n"
    (tmp_path / "greedy.cl").write_text(source)
    monkeypatch.setattr(paper, "SOURCES", tmp_path)
    for gpu in BOTH:
        if absent := paper.missing(gpu):
            pytest.skip(f"NOTHING COMPILED FOR {gpu.name}: not installed: {absent}")
        (kernel,) = paper.kernels(gpu, "greedy", {})
        assert kernel.name == "greedy_one" and kernel.spilled > 0, kernel


@pytest.mark.parametrize(
    ("registers", "local", "share"),
    [
        (32, 0, 1),
        (33, 0, 48 / 64),
        (72, 0, 28 / 64),
        (102, 0, 16 / 64),
        (128, 0, 16 / 64),
        (255, 0, 8 / 64),
        (32, 16 << 10, 18 / 64),
        (32, 96 << 10, 2 / 64),
    ],
)
def test_occupancy_is_what_the_occupancy_calculator_of_cuda_says(registers, local, share):
    assert paper._occupancy(paper.GPUS[0], registers, local) == share
