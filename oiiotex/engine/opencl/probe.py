# SPDX-License-Identifier: Apache-2.0
"""Probe of an OpenCL device in a separate process: a runtime that cannot compile may abort its process.

`oiiotex.engine.opencl.probe PLATFORM VERSION NUMBER CPU` builds and runs a kernel on device NUMBER of the platform, and
prints the number of lanes for the compiler's target. CPU: the name given to PoCL; empty: none.
"""

from __future__ import annotations

import sys

import numpy as np
import pyopencl as cl

from . import cpu as opencl_cpu
from .runtime import compilers_words, include_no_headers_of
from .source import expanded

_ITEMS = 64
_LOOPS = 100_000  # Mesa's llvmpipe ends the loops of a work-item after 65,535 iterations in total, without an error
# Uses cl/lanes.h like the other kernels, as a test of registers of that width. A compiler for x86 defines macros for
# its target; for Intel's, which first compiles to an intermediate language, the device's native width decides.
_SOURCE = """
#ifndef LANES
#if defined(__x86_64__) ? defined(__AVX512BW__) : NATIVE_SHORTS >= 32
#define LANES 32
#else
#define LANES 16
#endif
#endif
#include "lanes.h"
__kernel void probe(const __global short *numbers, __global int *sums, int loops) {
  int i = get_global_id(0);
  const __global short *own = numbers + 32 * i;
#if LANES > 16
  sums[i] = total16(squares32(*(const __global lane_s32 *)own));
#elif LANES > 1
  sums[i] = total8(squares16(*(const __global lane_s16 *)own) + squares16(*(const __global lane_s16 *)(own + 16)));
#else
  sums[i] = 0;
  for (int k = 0; k < 32; k++) sums[i] += own[k] * own[k];
#endif
  if (i > 0) return;
  int at = 0;
  for (int k = 0; k < loops; k++) at = (numbers[at] + 1) % (32 * (int)get_global_size(0));   // numbers[at] is at
  sums[get_global_size(0)] = at;
  sums[get_global_size(0) + 1] = LANES;
}
"""


def _lanes(device: cl.Device) -> int:
    """Build and run the kernel; returns the number of lanes that it was built for."""
    include_no_headers_of(cl)
    context = cl.Context([device])
    queue = cl.CommandQueue(context)
    options = ["-w", f"-DNATIVE_SHORTS={device.native_vector_width_short}"]
    if not device.type & cl.device_type.CPU:
        options.append("-DLANES=1")
    kernel = cl.Program(context, expanded(_SOURCE, "probe")).build(options).probe
    numbers = np.arange(32 * _ITEMS, dtype=np.int16)
    given = cl.Buffer(context, cl.mem_flags.READ_ONLY | cl.mem_flags.COPY_HOST_PTR, hostbuf=numbers)
    answer = np.empty(_ITEMS + 2, np.int32)
    taken = cl.Buffer(context, cl.mem_flags.WRITE_ONLY, answer.nbytes)
    kernel(queue, (_ITEMS,), (_ITEMS,), given, taken, np.int32(_LOOPS))
    cl.enqueue_copy(queue, answer, taken)
    if (answer[:-2] != (numbers.astype(np.int32).reshape(_ITEMS, 32) ** 2).sum(1)).any():
        raise ArithmeticError("a kernel computes wrong results")
    if answer[-2] != _LOOPS % len(numbers):
        raise ArithmeticError(f"a loop of {_LOOPS} iterations ends early")
    return int(answer[-1])


def main(platform: str, version: str, number: str, cpu: str) -> None:
    """Print the number of lanes, or exit with the error as the last line of stderr."""
    devices = next(p.get_devices() for p in cl.get_platforms() if (p.name, p.version) == (platform, version))
    device = devices[int(number)]
    try:
        if cpu:
            opencl_cpu.name_cpu(device, cpu)
        print(_lanes(device))
    except cl.Error as error:
        sys.exit(compilers_words(str(error)))
    except (ArithmeticError, LookupError) as error:
        sys.exit(str(error))


if __name__ == "__main__":
    main(*sys.argv[1:])
