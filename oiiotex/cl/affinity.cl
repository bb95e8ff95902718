// Affinity graph of points: LSA16 section 4.1, labels/affinity_graph.py. Distances are integers; weights are sums and
// products of floats in a fixed order.
#pragma OPENCL FP_CONTRACT OFF
#include "exponential.h"
#include "lanes.h"
#include "offsets.h"

#define FAR 2147483647
#define BLOCK 32   // points processed together; affinity_graph.py pads to it
#define LOCAL 6    // index of the neighbor whose distance is the local scale: LSA16 eq. 4

// Squared distances from point i to all points, FAR for those from `count` on. Coordinates are in pairs, (pair, point).
static inline void measure(const __global short *points, __global int *away, int i, int count, int padded,
                           int pairs) {
#if LANES > 1
  for (int j = 0; j < padded; j += BLOCK) {
    lane_i8 sum[BLOCK / 8];
    for (int t = 0; t < BLOCK / 8; t++) sum[t] = 0;
    for (int k = 0; k < pairs; k++) {
      const __global short *at = points + 2 * AT(k, j, padded);
      lane_i8 both = ((const __global int *)points)[AT(k, i, padded)];
      lane_s16 own = __builtin_astype(both, lane_s16);
      for (int t = 0; t < BLOCK / 8; t++) sum[t] += squares16(*(const __global lane_s16 *)(at + 16 * t) - own);
    }
    for (int t = 0; t < BLOCK / 8; t++)
      for (int k = 0; k < 8; k++) away[j + 8 * t + k] = sum[t][k];
  }
#else
  for (int j = 0; j < count; j++) {
    int sum = 0;
    for (int k = 0; k < pairs; k++) {
      const __global short *at = points + 2 * AT(k, j, padded), *own = points + 2 * AT(k, i, padded);
      int u = at[0] - own[0], v = at[1] - own[1];
      sum += u * u + v * v;
    }
    away[j] = sum;
  }
#endif
  for (int j = count; j < padded; j++) away[j] = FAR;
}

static inline int below(const __global int *away, int padded, int bound) {
#if LANES > 1
  lane_i8 fewer = 0;
  for (int j = 0; j < padded; j += 8) fewer -= *(const __global lane_i8 *)(away + j) < bound;
  return total8(fewer);
#else
  int fewer = 0;
  for (int j = 0; j < padded; j++) fewer += away[j] < bound;
  return fewer;
#endif
}

// The `wanted` nearest neighbors of each of `rows` points from `first` on, in index order; ties to the lower index.
// `scales`: the squared distance to the LOCALth neighbor, where each node counts as `copies` points. `distances` has
// `padded` numbers per row.
__kernel void affinity_nearest(const __global short *restrict points, const __global int *restrict copies,
                               __global int *restrict distances, __global int *restrict index,
                               __global int *restrict squared, __global int *restrict scales, int count, int padded,
                               int pairs, int wanted, int first, int rows) {
  int row = get_global_id(0), i = first + row;
  if (row >= rows || i >= count) return;
  __global int *away = distances + AT(row, 0, padded), *chosen = index + AT(i, 0, wanted);
  __global int *apart = squared + AT(i, 0, wanted);
  measure(points, away, i, count, padded, pairs);
  away[i] = FAR;
  // the largest bound with fewer than `wanted` distances below it, found bit by bit, or one with `wanted`
  int bound = 0, under = 0, n = 0;
  for (int bit = 30; bit >= 0 && under < wanted; bit--) {
    int fewer = below(away, padded, bound | (1 << bit));
    if (fewer <= wanted) bound |= 1 << bit, under = fewer;
  }
  int ties = wanted - under;
  int near[LOCAL], many[LOCAL], seen = copies[i] - 1;
  for (int t = 0; t < LOCAL; t++) near[t] = FAR, many[t] = 0;
  for (int j = 0; j < count && n < wanted; j++) {
    int d = away[j];
    if (d > bound || (d == bound && ties-- <= 0)) continue;
    chosen[n] = j;
    apart[n++] = d;
    if (d >= near[LOCAL - 1]) continue;
    int at = LOCAL - 1;
    for (; at > 0 && near[at - 1] > d; at--) near[at] = near[at - 1], many[at] = many[at - 1];
    near[at] = d;
    many[at] = copies[j];
  }
  int scale = 0;
  for (int t = 0; t < LOCAL && many[t] && seen < LOCAL; t++) {
    seen += many[t];
    scale = near[t];
  }
  scales[i] = scale;
}

// LSA16 eq. 4: weights of a node's edges and their sum. `near` holds 1 / scale of each node, `counted` the weight of
// an edge at distance 0.
__kernel void affinity_similar(const __global int *restrict starts, const __global int *restrict columns,
                               const __global int *restrict squared, const __global float *restrict counted,
                               const __global float *restrict near, __global float *restrict weights,
                               __global float *restrict mass, int count, float sharpness) {
  int i = get_global_id(0);
  if (i >= count) return;
  float sum = 0.0f;
  for (int p = starts[i]; p < starts[i + 1]; p++) {
    float relative = (float)squared[p] * (near[i] * near[columns[p]]);
    weights[p] = exponential(-(relative * sharpness)) * counted[p];
    sum += weights[p];
  }
  mass[i] = sum;
}

// T^-1/2 W T^-1/2: `less` holds 1 / sqrt of each node's mass.
__kernel void affinity_scaled(const __global int *restrict starts, const __global int *restrict columns,
                              const __global float *restrict less, __global float *restrict weights, int count) {
  int i = get_global_id(0);
  if (i >= count) return;
  for (int p = starts[i]; p < starts[i + 1]; p++) weights[p] *= less[i] * less[columns[p]];
}
