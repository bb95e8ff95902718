// Update of SLIC seeds in each iteration (LSA16 section 3.1), only built for devices with double precision. For others
// superpixels/slic.py computes the same, bit for bit: + - * / and rint in a fixed order.
#pragma OPENCL EXTENSION cl_khr_fp64 : enable
#pragma OPENCL FP_CONTRACT OFF
#include "offsets.h"

#define SUMS 6   // pixels, L, a, b, x, y
typedef int4 candidate;   // as in superpixels.cl

static inline int middle_of(const __global int *edges, int i) { return (edges[i] + edges[i + 1]) / 2; }

// Beyond a border of an image with that period lie the cells of the other border; a period of 0 has none there.
static inline int is_cell(int i, int count, int period) { return period || (i >= 0 && i < count); }
static inline int turns(int i, int count) { return i < 0 ? -1 : i >= count; }

// The nearest integer, ties to the even one: rint is a function call on CPUs. For less than 2^51 in magnitude.
static inline double rounded(double x) { return x + 6755399441055744.0 - 6755399441055744.0; }

// Centers (L, a, b, x, y) move to the mean of their pixels if its squared distance exceeds `still`; at the `start` all
// move, and seeds without pixels become NaN. A seed without an `active` cell around it has the pixels that it had.
__kernel void slic_seeds_move(const __global long *restrict totals, const __global uchar *restrict active,
                              const __global int *restrict row_edges, const __global int *restrict edges,
                              __global double *restrict centers, __global uchar *restrict moved, int across, int down,
                              int width, int height, double weight, double still, int start) {
  int gx = get_global_id(0), gy = get_global_id(1);
  if (gx >= across || gy >= down) return;
  size_t seed = AT(gy, gx, across);
  int some = start;
  for (int t = 0; t < 9; t++) {
    int x = gx + 1 - t % 3, y = gy + 1 - t / 3;
    if (is_cell(x, across, width) && is_cell(y, down, height))
      some |= active[AT(y - turns(y, down) * down, x - turns(x, across) * across, across)];
  }
  moved[seed] = 0;
  if (!some) return;
  long sum[SUMS] = {0, 0, 0, 0, 0, 0};
  for (int t = 0; t < 9; t++) {   // the seed's slot in a neighboring cell
    int x = gx + 1 - t % 3, y = gy + 1 - t / 3;
    if (!is_cell(x, across, width) || !is_cell(y, down, height)) continue;
    int right = turns(x, across), below = turns(y, down);
    x -= right * across;
    y -= below * down;
    const __global long *from = totals + SUMS * (9 * AT(y, x, across) + t);
    for (int k = 0; k < SUMS; k++) sum[k] += from[k];
    sum[4] += from[0] * (middle_of(edges, x) + right * width);
    sum[5] += from[0] * (middle_of(row_edges, y) + below * height);
  }
  double n = (double)sum[0], mean[5], squared[5];
  for (int k = 0; k < 5; k++) {
    mean[k] = (double)sum[k + 1] / n;
    double away = mean[k] - centers[5 * seed + k];
    squared[k] = away * away;
  }
  double away = squared[0] + squared[1] + squared[2] + weight * (squared[3] + squared[4]);
  moved[seed] = start || (sum[0] > 0 && away > still);
  if (moved[seed])
    for (int k = 0; k < 5; k++) centers[5 * seed + k] = sum[0] > 0 ? mean[k] : (double)NAN;
}

// Recomputes the candidates of cells with a moved seed; a cell is active if they have changed, and at the `start`.
__kernel void slic_seeds_follow(const __global double *restrict centers, const __global uchar *restrict moved,
                                 const __global int *restrict row_edges, const __global int *restrict edges,
                                 __global candidate *restrict candidates, __global uchar *restrict active, int across,
                                 int down, int width, int height, int absent, double per_color, double per_place, double color_unit,
                                 double place_unit, int start) {
  int gx = get_global_id(0), gy = get_global_id(1);
  if (gx >= across || gy >= down) return;
  int some = 0, changed = start;
  for (int y = gy - 1; y <= gy + 1; y++)
    for (int x = gx - 1; x <= gx + 1; x++)
      if (is_cell(x, across, width) && is_cell(y, down, height))
        some |= moved[AT(y - turns(y, down) * down, x - turns(x, across) * across, across)];
  size_t cell = AT(gy, gx, across);
  for (int t = 0; some && t < 9; t++) {
    int x = gx + t % 3 - 1, y = gy + t / 3 - 1, right = turns(x, across), below = turns(y, down);
    candidate c = (candidate)(absent, 0, 0, 0);
    const __global double *v = centers + 5 * AT(y - below * down, x - right * across, across);
    if (is_cell(x, across, width) && is_cell(y, down, height) && v[0] == v[0]) {
      double L = rounded(v[0] * per_color), a = rounded(v[1] * per_color), b = rounded(v[2] * per_color);
      double i = rounded((v[3] + right * width - middle_of(edges, gx)) * per_place);
      double j = rounded((v[4] + below * height - middle_of(row_edges, gy)) * per_place);
      double base = (L * L + a * a + b * b) / color_unit;
      base += (i * i + j * j) * place_unit;
      c.x = (int)rounded(base);
      c.y = ((int)L & 0xffff) | (int)a << 16;
      c.z = ((int)b & 0xffff) | (int)i << 16;
      c.w = (int)j;
    }
    candidate before = candidates[9 * cell + t];
    changed |= before.x != c.x || before.y != c.y || before.z != c.z || before.w != c.w;
    candidates[9 * cell + t] = c;
  }
  active[cell] = changed != 0;
}
