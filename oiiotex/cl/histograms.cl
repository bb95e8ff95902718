// Local histograms on a grid, and matching to them: MJH17 sections 3.2 and 4.3.
//
// The paper builds weighted histograms in overlapping blocks; here they stand on a grid of cells about sigma / 2.5
// apart and are read by interpolation, which comes as close to the dense version and costs a fraction
// (departure: cells instead of blocks). A histogram is BINS floats; the grid holds [channel][cell y][cell x][bin].
// Every cell is summed by one work-item in one fixed order, so the bits do not depend on the device.
#pragma OPENCL FP_CONTRACT OFF
#include "cells.h"

#if LANES > 1
#define BIN_LANES 16
typedef float bin_lane __attribute__((ext_vector_type(16), aligned(4)));
#else
#define BIN_LANES 1
typedef float bin_lane;
#endif

// A value's place among the bins: soft membership (a triangular Parzen window) of bins `bin` and `bin + 1`.
inline float place_in_bins(short value, float low, float per_bin) {
  float t = ((float)value - low) * per_bin;
  return t < 0.0f ? 0.0f : t > (float)(BINS - 1) ? (float)(BINS - 1) : t;
}

// Each pixel is shared bilinearly among the four cells around it. Seen from a cell: it gathers every pixel less
// than one cell away, weighted by a tent.
__kernel void histograms_gather(const __global short *restrict image, __global float *restrict grid,
                                __constant float *low, __constant float *per_bin,
                                int width, int height, int cells_x, int cells_y, int wrap_x, int wrap_y) {
  int cx = get_global_id(0), cy = get_global_id(1), c = get_global_id(2);
  if (cx >= cells_x || cy >= cells_y || c >= CHANNELS) return;
  float pitch_x = (float)width / (float)cells_x, pitch_y = (float)height / (float)cells_y;
  __global float *histogram = grid + ((c * cells_y + cy) * cells_x + cx) * BINS;
  for (int b = 0; b < BINS; b++) histogram[b] = 1e-6f * pitch_x * pitch_y;   // keeps the cumulative strictly rising
  float centre_x = ((float)cx + 0.5f) * pitch_x - 0.5f, centre_y = ((float)cy + 0.5f) * pitch_y - 0.5f;
  for (int y = floor_int(centre_y - pitch_y) + 1; (float)y < centre_y + pitch_y; y++) {
    if (!wrap_y && (y < 0 || y >= height)) continue;
    float away_y = (float)y < centre_y ? centre_y - (float)y : (float)y - centre_y;
    const __global short *row = image + CHANNELS * width * (y < 0 ? y + height : y >= height ? y - height : y) + c;
    for (int x = floor_int(centre_x - pitch_x) + 1; (float)x < centre_x + pitch_x; x++) {
      if (!wrap_x && (x < 0 || x >= width)) continue;
      float away_x = (float)x < centre_x ? centre_x - (float)x : (float)x - centre_x;
      short value = row[CHANNELS * (x < 0 ? x + width : x >= width ? x - width : x)];
      if (value == SHRT_MIN) continue;   // histograms.OUTSIDE: no pixel of the image
      float weight = (1.0f - away_y / pitch_y) * (1.0f - away_x / pitch_x);
      float t = place_in_bins(value, low[c], per_bin[c]);
      int b = (int)t < BINS - 2 ? (int)t : BINS - 2;
      float upper = (t - (float)b) * weight;
      histogram[b] += weight - upper;
      histogram[b + 1] += upper;
    }
  }
}

// One axis of the Gaussian w_d of MJH17 eq. 3 over the cells, BIN_LANES bins of a cell at a time. `stride` is the
// step along the axis and `n` its length, `across` and `across_stride` the same for the other axis, all in cells.
__kernel void histograms_blur(const __global float *restrict grid, __global float *restrict blurred,
                              __constant float *weights, int radius, int n, int stride, int across, int across_stride, int wrap) {
  int part = get_global_id(0) * BIN_LANES, i = get_global_id(1), jc = get_global_id(2);
  if (part >= BINS || i >= n || jc >= CHANNELS * across) return;
  int c = jc / across, j = jc - c * across;
  int line = (c * n * across + j * across_stride) * BINS + part;
  bin_lane sum = 0.0f;
  for (int k = -radius; k <= radius; k++) {
    int at = i + k;
    while (wrap && at < 0) at += n;
    while (wrap && at >= n) at -= n;
    if (at >= 0 && at < n) sum += weights[k + radius] * *(const __global bin_lane *)(grid + line + at * stride * BINS);
  }
  *(__global bin_lane *)(blurred + line + i * stride * BINS) = sum;
}

// Sums of a row of cells, bin by bin: the rows are added on the host to the global histogram.
__kernel void histograms_row_sums(const __global float *restrict grid, __global float *restrict sums, int cells_x, int rows) {
  int part = get_global_id(0) * BIN_LANES, row = get_global_id(1);
  if (part >= BINS || row >= rows) return;
  bin_lane sum = 0.0f;
  for (int x = 0; x < cells_x; x++) sum += *(const __global bin_lane *)(grid + (row * cells_x + x) * BINS + part);
  *(__global bin_lane *)(sums + row * BINS + part) = sum;
}

// Histogram -> its cumulative, normalised: value b is the share below the lower border of bin b.
__kernel void histograms_cumulate(__global float *restrict grid, int cells) {
  int i = get_global_id(0);
  if (i >= cells) return;
  __global float *h = grid + i * BINS;
  float total = 0.0f;
  for (int b = 0; b < BINS; b++) total += h[b];
  float scale = 1.0f / total, below = 0.0f;
  for (int b = 0; b < BINS; b++) {
    float share = h[b];
    h[b] = below * scale;
    below += share;
  }
}

// The cumulative of one cell at place t; linear inside the bin [b - 1/2, b + 1/2).
inline float share_below(const __global float *cumulative, int b, float inside) {
  float upper = b + 1 < BINS ? cumulative[b + 1] : 1.0f;
  return cumulative[b] + (upper - cumulative[b]) * inside;
}

// c' = G^-1(F(c)), MJH17 section 4.3 (printed there as 'G(F(c))^-1'): F is interpolated between the four cells
// around the pixel, `inverse` holds G^-1 as INVERSE + 1 values for shares 0 .. 1, already on the image's grid.
// The pixel goes `strength` times the way from c to c'.
__kernel void histograms_match(const __global short *restrict image, const __global float *restrict cumulative,
                               const __global float *restrict inverse, __global short *restrict matched,
                               __constant float *low, __constant float *per_bin, float strength,
                               int width, int height, int cells_x, int cells_y, int wrap_x, int wrap_y) {
  int x = get_global_id(0), y = get_global_id(1), c = get_global_id(2);
  if (x >= width || y >= height || c >= CHANNELS) return;
  float gx = ((float)x + 0.5f) * ((float)cells_x / (float)width) - 0.5f;
  float gy = ((float)y + 0.5f) * ((float)cells_y / (float)height) - 0.5f;
  int x0 = floor_int(gx), y0 = floor_int(gy);
  float right = gx - (float)x0, lower = gy - (float)y0;
  short old = image[CHANNELS * (y * width + x) + c];
  float t = place_in_bins(old, low[c], per_bin[c]);
  int b = (int)(t + 0.5f);
  float inside = t + 0.5f - (float)b;
  float share = 0.0f, weights = 0.0f;
  for (int k = 0; k < 4; k++) {
    int cx = cell_at(x0 + (k & 1), cells_x, wrap_x), cy = cell_at(y0 + (k >> 1), cells_y, wrap_y);
    if (cx < 0 || cy < 0) continue;
    float w = ((k & 1) ? right : 1.0f - right) * ((k >> 1) ? lower : 1.0f - lower);
    share += w * share_below(cumulative + ((c * cells_y + cy) * cells_x + cx) * BINS, b, inside);
    weights += w;
  }
  share = share / weights * (float)INVERSE;
  int i = (int)share < INVERSE - 1 ? (int)share : INVERSE - 1;
  const __global float *g = inverse + c * (INVERSE + 1) + i;
  float value = (float)old + strength * (g[0] + (g[1] - g[0]) * (share - (float)i) - (float)old);
  float least = inverse[c * (INVERSE + 1)], most = inverse[c * (INVERSE + 1) + INVERSE];
  value = value < least ? least : value > most ? most : value;
  matched[CHANNELS * (y * width + x) + c] = (short)floor_int(value + 0.5f);
}

// Point function of a value: global histogram matching is one table per channel on the integer grid.
__kernel void histograms_table(__global short *restrict image, const __global short *restrict table, int first, int entries, int pixels) {
  int p = get_global_id(0);
  if (p >= pixels) return;
  for (int c = 0; c < CHANNELS; c++) image[CHANNELS * p + c] = table[c * entries + image[CHANNELS * p + c] - first];
}
