// Local moments on a grid of cells, and matching to the image's own: MJH17 sections 3.1 and 4.3.
//
// The cells are those of histograms.cl. Every cell is summed by one work-item in a fixed order, about an integer near
// its mean, to avoid cancellation; the host computes the steps between cells and scores, in doubles.
#pragma OPENCL FP_CONTRACT OFF
#include "grid.h"

// Adds rows `begin` to `end`, distributed bilinearly as in histograms_gather, to `count` rows of cells from `top` on,
// which are held from row `at` on: [channel][cell y][cell x][weight, about, four sums]. The first pass sums weights and
// values, two `powers` about 0; after moments_about the second sums all five.
__kernel void moments_gather(const __global short *restrict image, __global float *restrict sums, int powers,
                             int begin, int end, int top, int count, int at, HELD_ARGS, GRID_ARGS) {
  int cx = get_global_id(0), row_of_cells = get_global_id(1), c = get_global_id(2);
  if (cx >= cells_x || row_of_cells >= count || c >= CHANNELS) return;
  tent across = tent_of(cx, width, cells_x), down = tent_of(top + row_of_cells, height, cells_y);
  __global float *out = sums + 6 * CELL(c, at + row_of_cells, cx);
  float about = out[1], sum[5] = {out[0], out[2], out[3], out[4], out[5]};
  for (int y = down.first < begin ? begin : down.first; y < end && tent_covers(down, y); y++) {
    if (!THERE(y, height, wrap_y)) continue;
    float above = tent_at(down, y);
    const __global short *row = image + CHANNELS * AT(HELD(y), 0, width) + c;
    for (int x = across.first; tent_covers(across, x); x++) {
      if (!THERE(x, width, wrap_x)) continue;
      short value = row[CHANNELS * WRAPPED(x, width)];
      if (value == SHRT_MIN) continue;   // histograms.OUTSIDE: not a pixel of the image
      float term = above * tent_at(across, x), off = (float)value - about;
      for (int k = 0; k < powers; k++) {
        sum[k] += term;
        term *= off;
      }
    }
  }
  out[0] = sum[0];
  for (int k = 1; k < 5; k++) out[1 + k] = sum[k];
}

// Sets the center of the powers, an integer near the mean, and clears all sums.
__kernel void moments_about(__global float *restrict sums, int cells_x, int rows) {
  int cx = get_global_id(0), row = get_global_id(1);
  if (cx >= cells_x || row >= rows) return;
  __global float *out = sums + 6 * AT(row, cx, cells_x);
  out[1] = out[0] > 0.0f ? (float)floor_int(out[2] / out[0] + 0.5f) : 0.0f;
  out[0] = out[2] = out[3] = out[4] = out[5] = 0.0f;
}

// Cumulative distribution of a Pearson distribution, at a place in standard deviations: pearson_table.shares_below.
static inline float share_below(const __global float *quantiles, const __global float *shares, float u, float skewness, float kurtosis) {
  float s = skewness < 0.0f ? -skewness : skewness, at = skewness < 0.0f ? -u : u;
  int i = (int)s < SKEWNESSES - 2 ? (int)s : SKEWNESSES - 2, j = (int)kurtosis < KURTOSES - 2 ? (int)kurtosis : KURTOSES - 2;
  float a = s - (float)i, b = kurtosis - (float)j;
  float w0 = (1.0f - a) * (1.0f - b), w1 = (1.0f - a) * b, w2 = a * (1.0f - b), w3 = a * b;
  const __global float *q = quantiles + (i * KURTOSES + j) * SCORES;
  int first = -1, last = SCORES;   // the quantile at `first` is at most the place, that at `last` is above it
  float below = 0.0f, above = 0.0f;
  while (last - first > 1) {
    int n = (first + last) / 2;
    float v = w0 * q[n] + w1 * q[SCORES + n] + w2 * q[KURTOSES * SCORES + n] + w3 * q[(KURTOSES + 1) * SCORES + n];
    if (v <= at) { first = n; below = v; }
    else { last = n; above = v; }
  }
  float share = first < 0 ? 0.0f : last == SCORES ? 1.0f
                : shares[first] + (shares[last] - shares[first]) * ((at - below) / (above - below));
  return skewness < 0.0f ? 1.0f - share : share;
}

// c' = G^-1(F(c)), MJH17 section 4.3, with F the distribution of the moments around the pixel ([mean, deviation, places
// of skewness and kurtosis in the table] of four cells, interpolated) and G that of the image; `inverse` holds G^-1
// at INVERSE + 1 fractions. F is averaged over a bin of width `bin`, as if sampled. With two moments both distributions
// are normal, and the map is affine (`overall`: mean, deviation).
__kernel void moments_match(const __global short *restrict image, const __global float *restrict around,
                            const __global float *restrict quantiles, const __global float *restrict shares,
                            const __global float *restrict inverse, __constant float *overall,
                            __global short *restrict matched, __constant float *low, __constant float *high,
                            __constant float *bin, float strength, int normal, int top, int count,
                            HELD_ARGS, GRID_ARGS) {
  int x = get_global_id(0), y = top + get_global_id(1), c = get_global_id(2);
  if (x >= width || y >= top + count || c >= CHANNELS) return;
  size_t cell[4];
  float weight[4], weights = cells_around(x, WRAPPED(y, height), GRID, first_cells, cell, weight), of[4] = {0.0f, 0.0f, 0.0f, 0.0f};
  for (int k = 0; k < 4; k++)
    for (int m = 0; m < 4; m++) of[m] += weight[k] * around[4 * (CELL(c, 0, 0) + cell[k]) + m];
  size_t row = CHANNELS * AT(HELD(y), 0, width) + c;
  float old = (float)image[row + CHANNELS * x];
  float mean = of[0] / weights, deviation = of[1] / weights, value;
  if (normal) {
    value = overall[2 * c] + overall[2 * c + 1] * ((old - mean) / deviation);
  } else {
    float share = 0.0f;
    for (int k = -1; k <= 1; k += 2)
      share += 0.5f * share_below(quantiles, shares, (old + 0.25f * (float)k * bin[c] - mean) / deviation,
                                  of[2] / weights, of[3] / weights);
    share *= (float)INVERSE;
    int i = (int)share < INVERSE - 1 ? (int)share : INVERSE - 1;
    const __global float *g = inverse + c * (INVERSE + 1) + i;
    value = g[0] + (g[1] - g[0]) * (share - (float)i);
  }
  value = old + strength * (value - old);
  value = value < low[c] ? low[c] : value > high[c] ? high[c] : value;
  matched[row + CHANNELS * x] = (short)floor_int(value + 0.5f);
}
