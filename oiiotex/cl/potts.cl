// The mean field of a Potts model: what places are members of, minding their surroundings. labels/potts.py.
// Layers lie one after the other, (label, place). Floats are added and multiplied in one fixed order.
#pragma OPENCL FP_CONTRACT OFF
#include "exponential.h"
#include "offsets.h"

// 1 / x for x >= 1, by + and * alone: a division is not the same on every device.
static inline float reciprocal(float x) {
  float y = as_float(0x7ef311c7 - as_int(x));
  for (int n = 0; n < 4; n++) y = y * (2.0f - x * y);
  return y;
}

// The mean of what a place's neighbors are: those of place i stand from starts[i] on.
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

// Shares of labels, proportional to e^(alone + coupling around), 0 where nothing is seen.
__kernel void potts_members(const __global float *restrict alone, const __global float *restrict around,
                            const __global uchar *restrict seen, __global float *restrict member, int places,
                            int labels, float coupling) {
  int i = get_global_id(0);
  if (i >= places) return;
  float most = -1e30f, total = 0.0f;
  for (int k = 0; k < labels; k++) {
    float pull = alone[AT(k, i, places)] + coupling * around[AT(k, i, places)];
    most = pull > most ? pull : most;
    member[AT(k, i, places)] = pull;
  }
  for (int k = 0; k < labels; k++) {
    float share = exponential(member[AT(k, i, places)] - most);
    member[AT(k, i, places)] = share;
    total += share;
  }
  float scale = seen[i] ? reciprocal(total) : 0.0f;
  for (int k = 0; k < labels; k++) member[AT(k, i, places)] *= scale;
}

// The label of most votes at every pixel, the first of equal ones: votes of cells, (label, cell y, cell x), are taken
// linearly between the cells' middles. `rows` and `columns` say the cell before a pixel, `below` and `right` how far on
// to the next one it lies.
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
