// Local moments on a grid of cells, and matching to the image's own: MJH17 sections 3.1 and 4.3.
//
// The cells are those of histograms.cl. Every cell is summed by one work-item in one fixed order, about a whole number
// near its mean, so that no digits are lost; what lies between cells and scores is done on the host, in doubles.
#pragma OPENCL FP_CONTRACT OFF
#include "cells.h"

// Shared bilinearly among the cells, as in histograms_gather: [channel][cell y][cell x][weight, about, four sums].
__kernel void moments_gather(const __global short *restrict image, __global float *restrict sums,
                             int width, int height, int cells_x, int cells_y, int wrap_x, int wrap_y) {
  int cx = get_global_id(0), cy = get_global_id(1), c = get_global_id(2);
  if (cx >= cells_x || cy >= cells_y || c >= CHANNELS) return;
  float pitch_x = (float)width / (float)cells_x, pitch_y = (float)height / (float)cells_y;
  float centre_x = ((float)cx + 0.5f) * pitch_x - 0.5f, centre_y = ((float)cy + 0.5f) * pitch_y - 0.5f;
  float about = 0.0f, sum[5];
  for (int pass = 0; pass < 2; pass++) {
    for (int k = 0; k < 5; k++) sum[k] = 0.0f;
    for (int y = floor_int(centre_y - pitch_y) + 1; (float)y < centre_y + pitch_y; y++) {
      if (!wrap_y && (y < 0 || y >= height)) continue;
      float away_y = (float)y < centre_y ? centre_y - (float)y : (float)y - centre_y;
      const __global short *row = image + CHANNELS * width * (y < 0 ? y + height : y >= height ? y - height : y) + c;
      for (int x = floor_int(centre_x - pitch_x) + 1; (float)x < centre_x + pitch_x; x++) {
        if (!wrap_x && (x < 0 || x >= width)) continue;
        float away_x = (float)x < centre_x ? centre_x - (float)x : (float)x - centre_x;
        short value = row[CHANNELS * (x < 0 ? x + width : x >= width ? x - width : x)];
        if (value == SHRT_MIN) continue;   // histograms.OUTSIDE: no pixel of the image
        float term = (1.0f - away_y / pitch_y) * (1.0f - away_x / pitch_x), off = (float)value - about;
        for (int k = 0; k < (pass ? 5 : 2); k++) {
          sum[k] += term;
          term *= off;
        }
      }
    }
    if (!pass && sum[0] > 0.0f) about = (float)floor_int(sum[1] / sum[0] + 0.5f);
  }
  __global float *out = sums + 6 * ((c * cells_y + cy) * cells_x + cx);
  out[0] = sum[0];
  out[1] = about;
  for (int k = 1; k < 5; k++) out[1 + k] = sum[k];
}

// The share that lies below a place, in deviations from the mean, of a Pearson distribution: pearson.shares_below.
inline float share_below(const __global float *quantiles, const __global float *shares, float u, float skewness, float kurtosis) {
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
// of skewness and kurtosis in the table] of four cells, interpolated) and G that of the image's; `inverse` holds G^-1
// at INVERSE + 1 shares. F is a mean over a bin of width `bin`, as if it had been sampled. Of two moments both are
// normal, and this is an affine map (`overall`: mean, deviation).
__kernel void moments_match(const __global short *restrict image, const __global float *restrict around,
                            const __global float *restrict quantiles, const __global float *restrict shares,
                            const __global float *restrict inverse, __constant float *overall,
                            __global short *restrict matched, __constant float *low, __constant float *high,
                            __constant float *bin, float strength, int normal,
                            int width, int height, int cells_x, int cells_y, int wrap_x, int wrap_y) {
  int x = get_global_id(0), y = get_global_id(1), c = get_global_id(2);
  if (x >= width || y >= height || c >= CHANNELS) return;
  float gx = ((float)x + 0.5f) * ((float)cells_x / (float)width) - 0.5f;
  float gy = ((float)y + 0.5f) * ((float)cells_y / (float)height) - 0.5f;
  int x0 = floor_int(gx), y0 = floor_int(gy);
  float right = gx - (float)x0, lower = gy - (float)y0;
  float of[4] = {0.0f, 0.0f, 0.0f, 0.0f}, weights = 0.0f;
  for (int k = 0; k < 4; k++) {
    int cx = cell_at(x0 + (k & 1), cells_x, wrap_x), cy = cell_at(y0 + (k >> 1), cells_y, wrap_y);
    if (cx < 0 || cy < 0) continue;
    float w = ((k & 1) ? right : 1.0f - right) * ((k >> 1) ? lower : 1.0f - lower);
    for (int m = 0; m < 4; m++) of[m] += w * around[4 * ((c * cells_y + cy) * cells_x + cx) + m];
    weights += w;
  }
  float old = (float)image[CHANNELS * (y * width + x) + c];
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
  matched[CHANNELS * (y * width + x) + c] = (short)floor_int(value + 0.5f);
}
