// The mean field of a Potts model: label probabilities with a smoothness term, labels/potts.py. Arrays are
// (label, place). Floats are added and multiplied in a fixed order.
#pragma OPENCL FP_CONTRACT OFF
#include "exponential.h"
#include "offsets.h"

// 1 / x for x >= 1, only by + and *: division differs between devices.
static inline float reciprocal(float x) {
  float y = as_float(0x7ef311c7 - as_int(x));
  for (int n = 0; n < 4; n++) y = y * (2.0f - x * y);
  return y;
}

// The mean of the neighbors' probabilities; the neighbors of place i are listed from starts[i] on.
__kernel void potts_around(const __global int *restrict starts, const __global int *restrict neighbors,
                           const __global float *restrict member, __global float *restrict around, int places,
                           int labels) {
  int i = get_global_id(0), k = get_global_id(1);
  if (i >= places || k >= labels) return;
  float sum = 0.0f;
  int count = starts[i + 1] - starts[i];
  for (int p = starts[i]; p < starts[i + 1]; p++) sum += member[AT(k, neighbors[p], places)];
  around[AT(k, i, places)] = count > 1 ? sum * reciprocal((float)count) : sum;
}

// Label probabilities, proportional to e^(alone + coupling around), 0 where nothing is opaque. An item computes BLOCK
// places, so that compilers for CPUs turn the loops over them into vectors.
#if LANES > 1
#define BLOCK 16   // potts.py
#else
#define BLOCK 1
#endif
__kernel void potts_members(const __global float *restrict alone, const __global float *restrict around,
                            const __global uchar *restrict seen, __global float *restrict member, int places,
                            int labels, float coupling) {
  int first = get_global_id(0) * BLOCK, count = places - first < BLOCK ? places - first : BLOCK;
  if (count <= 0) return;
  float most[BLOCK], scale[BLOCK];
  for (int i = 0; i < count; i++) most[i] = -1e30f, scale[i] = 0.0f;
  for (int k = 0; k < labels; k++) {
    size_t at = AT(k, first, places);
    for (int i = 0; i < count; i++) {
      float pull = alone[at + i] + coupling * around[at + i];
      most[i] = pull > most[i] ? pull : most[i];
      member[at + i] = pull;
    }
  }
  for (int k = 0; k < labels; k++) {
    size_t at = AT(k, first, places);
    for (int i = 0; i < count; i++) {
      float share = exponential(member[at + i] - most[i]);
      member[at + i] = share;
      scale[i] += share;
    }
  }
  for (int i = 0; i < count; i++) scale[i] = seen[first + i] ? reciprocal(scale[i]) : 0.0f;
  for (int k = 0; k < labels; k++) {
    size_t at = AT(k, first, places);
    for (int i = 0; i < count; i++) member[at + i] *= scale[i];
  }
}

// The label with the most votes at every pixel, ties to the first: votes of cells, (label, cell y, cell x), are
// interpolated linearly between the cells' centers. `rows` and `columns` hold the cell before a pixel, `below` and
// `right` the fraction of the way to the next one.
__kernel void potts_winners(const __global float *restrict votes, const __global int *restrict rows,
                            const __global int *restrict columns, const __global float *restrict below,
                            const __global float *restrict right, __global uchar *restrict winners, int width,
                            int height, int across, int down, int labels) {
  int x = get_global_id(0), y = get_global_id(1);
  if (x >= width || y >= height) return;
  int top = rows[y], bottom = top + 1 < down ? top + 1 : top;
  int left = columns[x], next = left + 1 < across ? left + 1 : left, best = 0;
  float v = below[y], u = right[x], most = -1.0f;
  for (int k = 0; k < labels; k++) {
    const __global float *layer = votes + AT(k * down, 0, across);
    float one = layer[AT(top, left, across)] * (1.0f - v) + layer[AT(bottom, left, across)] * v;
    float two = layer[AT(top, next, across)] * (1.0f - v) + layer[AT(bottom, next, across)] * v;
    float vote = one * (1.0f - u) + two * u;
    best = vote > most ? k : best;
    most = vote > most ? vote : most;
  }
  winners[AT(y, x, width)] = (uchar)best;
}
