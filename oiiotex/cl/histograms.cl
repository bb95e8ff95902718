// Local histograms on a grid, and matching to them: MJH17 sections 3.2 and 4.3.
//
// The paper builds weighted histograms in overlapping blocks; here they are on a grid of cells about sigma / 2.5
// apart and are interpolated, which is as close to the dense version at a fraction of the cost
// (departure: cells instead of blocks). A histogram is BINS floats; the grid holds [channel][cell y][cell x][bin].
// Every cell is summed by one work-item in a fixed order, so the bits do not depend on the device.
#pragma OPENCL FP_CONTRACT OFF
#include "grid.h"

#if LANES > 1
#define BIN_LANES 16
typedef float bin_lane __attribute__((ext_vector_type(16), aligned(4)));
#else
#define BIN_LANES 4   // 16 bytes: one load of a GPU
typedef float4 bin_lane;

// Rounded up to an integer.
static inline int first_from(float v) { int i = floor_int(v); return (float)i < v ? i + 1 : i; }
#endif

// Soft membership of a value (triangular Parzen window) in bins `bin` and `bin + 1`.
static inline float place_in_bins(short value, float low, float per_bin) {
  float t = ((float)value - low) * per_bin;
  return t < 0.0f ? 0.0f : t > (float)(BINS - 1) ? (float)(BINS - 1) : t;
}

// Adds rows `begin` to `end` of the image (counted beyond its border) to the histograms of `count` rows of cells from
// `top` on, which are held from row `at` on. Rows are added in order, so the sums do not depend on the size of bands.
#if LANES > 1
// One item sums a cell, interleaving its channels: they share weights, and independent sums hide latency.
__kernel void histograms_gather(const __global short *restrict image, __global float *restrict grid,
                                __constant float *low, __constant float *per_bin, int begin, int end,
                                int top, int count, int at, HELD_ARGS, GRID_ARGS) {
  int cx = get_global_id(0), row_of_cells = get_global_id(1), cy = top + row_of_cells;
  if (cx >= cells_x || row_of_cells >= count) return;
  tent across = tent_of(cx, width, cells_x), down = tent_of(cy, height, cells_y);
  __global float *histograms = grid + CELL(0, at + row_of_cells, cx) * BINS;
  size_t plane = (size_t)cells_x * held_cells * BINS;   // stride between channels
  for (int y = down.first < begin ? begin : down.first; y < end && tent_covers(down, y); y++) {
    if (!THERE(y, height, wrap_y)) continue;
    float above = tent_at(down, y);
    const __global short *row = image + CHANNELS * AT(HELD(y), 0, width);
    for (int x = across.first; tent_covers(across, x); x++) {
      if (!THERE(x, width, wrap_x)) continue;
      float weight = above * tent_at(across, x);
      const __global short *values = row + CHANNELS * WRAPPED(x, width);
      for (int c = 0; c < CHANNELS; c++) {
        if (values[c] == SHRT_MIN) continue;   // histograms.OUTSIDE: not a pixel of the image
        float t = place_in_bins(values[c], low[c], per_bin[c]);
        int b = (int)t < BINS - 2 ? (int)t : BINS - 2;
        float upper = (t - (float)b) * weight;
        histograms[c * plane + b] += weight - upper;
        histograms[c * plane + b + 1] += upper;
      }
    }
  }
}
#else
// A work-group of BINS items sums a cell, one bin per item: the items load and bin BINS pixels at a time, and each
// item adds those of its bin in the same order as above.
__kernel void histograms_gather(const __global short *restrict image, __global float *restrict grid,
                                __constant float *low, __constant float *per_bin, int begin, int end,
                                int top, int count, int at, HELD_ARGS, GRID_ARGS) {
  int own = get_local_id(0), cx = get_global_id(0) / BINS, row_of_cells = get_global_id(1), c = get_global_id(2);
  tent across = tent_of(cx, width, cells_x), down = tent_of(top + row_of_cells, height, cells_y);
  int columns = first_from(across.center + across.pitch) - across.first;
  int last = first_from(down.center + down.pitch), from = down.first < begin ? begin : down.first;
  int pixels = ((last < end ? last : end) - from) * columns;
  __global float *histogram = grid + CELL(c, at + row_of_cells, cx) * BINS;
  __local int bin[BINS];
  __local float at_bin[BINS], above_bin[BINS];
  float sum = histogram[own];
  for (int done = 0; done < pixels; done += BINS) {
    int i = done + own, y = from + i / columns, x = across.first + i % columns;
    bin[own] = -2;   // not a pixel
    if (i < pixels && THERE(y, height, wrap_y) && THERE(x, width, wrap_x)) {
      short value = image[CHANNELS * AT(HELD(y), WRAPPED(x, width), width) + c];
      if (value != SHRT_MIN) {
        float weight = tent_at(down, y) * tent_at(across, x);
        float t = place_in_bins(value, low[c], per_bin[c]);
        int b = (int)t < BINS - 2 ? (int)t : BINS - 2;
        bin[own] = b;
        above_bin[own] = (t - (float)b) * weight;
        at_bin[own] = weight - above_bin[own];
      }
    }
    barrier(CLK_LOCAL_MEM_FENCE);
    for (int k = 0; k < BINS; k++) {
      if (bin[k] == own) sum += at_bin[k];
      if (bin[k] + 1 == own) sum += above_bin[k];
    }
    barrier(CLK_LOCAL_MEM_FENCE);
  }
  histogram[own] = sum;
}
#endif

// One axis of the Gaussian w_d of MJH17 eq. 3 over the cells, BIN_LANES bins of a cell at a time. `stride` is the
// step along the axis and `n` its length, `across` and `across_stride` the same for the other axis, `plane` the step from
// a channel to the next, all in cells. Along the axis it is made from `from` to `to`.
__kernel void histograms_blur(const __global float *restrict grid, __global float *restrict blurred,
                              __constant float *weights, int radius, int n, int stride, int across, int across_stride,
                              int plane, int from, int to, int wrap) {
  int part = get_global_id(0) * BIN_LANES, i = from + get_global_id(1), jc = get_global_id(2);
  if (part >= BINS || i >= to || jc >= CHANNELS * across) return;
  int c = jc / across, j = jc - c * across;
  long line = ((long)c * plane + (long)j * across_stride) * BINS + part, step = (long)stride * BINS;
  bin_lane sum = 0.0f;
  for (int k = -radius; k <= radius; k++) {
    int at = i + k;
    while (wrap && at < 0) at += n;
    while (wrap && at >= n) at -= n;
    if (at >= 0 && at < n) sum += weights[k + radius] * *(const __global bin_lane *)(grid + line + at * step);
  }
  *(__global bin_lane *)(blurred + line + i * step) = sum;
}

// Sums over rows of cells, bin by bin: [channel][cell y][bin], for `count` of the `held_cells` rows, stored from row `top` on.
__kernel void histograms_row_sums(const __global float *restrict grid, __global float *restrict sums, int cells_x, int held_cells,
                                  int count, int top, int cells_y) {
  int part = get_global_id(0) * BIN_LANES, row = get_global_id(1), c = get_global_id(2);
  if (part >= BINS || row >= count || c >= CHANNELS) return;
  const __global float *from = grid + CELL(c, row, 0) * BINS + part;
  bin_lane sum = 0.0f;
  for (int x = 0; x < cells_x; x++) sum += *(const __global bin_lane *)(from + (size_t)x * BINS);
  *(__global bin_lane *)(sums + AT((long)c * cells_y + top + row, part, BINS)) = sum;
}

// The global histogram, [channel][bin], from the sums of all rows: in integers of 2^-16 pixel.
__kernel void histograms_totals(const __global float *restrict sums, __global ulong *restrict totals, int rows) {
  int b = get_global_id(0), c = get_global_id(1);
  if (b >= BINS || c >= CHANNELS) return;
  ulong total = 0;
  for (int row = 0; row < rows; row++) total += convert_ulong_rtz(sums[AT((long)c * rows + row, b, BINS)] * 65536.0f);
  totals[c * BINS + b] = total;
}

// G^-1 at equidistant shares, [channel][INVERSE + 1], on the image's grid from `low` to `high`. G: its global histogram.
// An item computes SHARES of them.
#define SHARES 64
__kernel void histograms_inverse(const __global ulong *restrict totals, __global float *restrict inverse,
                                 __constant float *low, __constant float *high, __constant float *per_bin) {
  int first = get_global_id(0) * SHARES, c = get_global_id(1), b = 0;
  if (first > INVERSE || c >= CHANNELS) return;
  const __global ulong *own = totals + c * BINS;
  ulong all = 0, below = 0;
  for (int i = 0; i < BINS; i++) all += own[i];
  for (int k = first; k < first + SHARES && k <= INVERSE; k++) {
    ulong sought = all * (ulong)k;   // of `all` times INVERSE
    while (b < BINS && (below + own[b]) * INVERSE <= sought) below += own[b++];
    float inside = b < BINS ? (float)(sought - below * INVERSE) / (float)(own[b] * INVERSE) : 0.0f;
    float value = low[c] + ((float)b - 0.5f + inside) / per_bin[c];
    inverse[c * (INVERSE + 1) + k] = value < low[c] ? low[c] : value > high[c] ? high[c] : value;
  }
}

// Normalized cumulative histogram: value b is the fraction below the lower border of bin b.
__kernel void histograms_cumulate(__global float *restrict grid, int cells_x, int rows) {
  int cx = get_global_id(0), row = get_global_id(1);
  if (cx >= cells_x || row >= rows) return;
  __global float *h = grid + AT(row, cx, cells_x) * BINS;
  float total = 0.0f;
  for (int b = 0; b < BINS; b++) total += h[b];
  float scale = 1.0f / total, below = 0.0f;
  for (int b = 0; b < BINS; b++) {
    float share = h[b];
    h[b] = below * scale;
    below += share;
  }
}

// c' = G^-1(F(c)), MJH17 section 4.3 (printed there as 'G(F(c))^-1'): F is interpolated between the four cells
// around the pixel and linear inside the bin [b - 1/2, b + 1/2); `inverse` holds G^-1 as INVERSE + 1 values for
// fractions 0 to 1, already on the image's grid. The result is c + strength (c' - c), for `count` rows from `top` on
// (counted beyond the border); `matched` holds the same rows as `image`.
__kernel void histograms_match(const __global short *restrict image, const __global float *restrict cumulative,
                               const __global float *restrict inverse, __global short *restrict matched,
                               __constant float *low, __constant float *per_bin, float strength, int top, int count,
                               HELD_ARGS, GRID_ARGS) {
  int x = get_global_id(0), y = top + get_global_id(1);
  if (x >= width || y >= top + count) return;
  size_t cell[4];
  float weight[4], weights = cells_around(x, WRAPPED(y, height), GRID, first_cells, cell, weight);
  size_t at = CHANNELS * AT(HELD(y), x, width), plane = (size_t)cells_x * held_cells;
  for (int c = 0; c < CHANNELS; c++) {
    short old = image[at + c];
    float t = place_in_bins(old, low[c], per_bin[c]);
    int b = (int)(t + 0.5f);
    float inside = t + 0.5f - (float)b, share = 0.0f;
    for (int k = 0; k < 4; k++) {
      const __global float *below = cumulative + (c * plane + cell[k]) * BINS + b;
      float upper = b + 1 < BINS ? below[1] : 1.0f;
      share += weight[k] * (below[0] + (upper - below[0]) * inside);
    }
    share = share / weights * (float)INVERSE;
    int i = (int)share < INVERSE - 1 ? (int)share : INVERSE - 1;
    const __global float *table = inverse + c * (INVERSE + 1), *g = table + i;
    float value = (float)old + strength * (g[0] + (g[1] - g[0]) * (share - (float)i) - (float)old);
    float least = table[0], most = table[INVERSE];
    value = value < least ? least : value > most ? most : value;
    matched[at + c] = (short)floor_int(value + 0.5f);
  }
}

// --- global matching: a value's histogram is exact on the integer grid ---

// Counts of each value in `height` rows from row `at` on, in parts: [part][channel][value - first]. A work-group counts
// one part of the rows, for one channel, into separate counts. `marks` excludes pixels: with COUNT_FREE those where it
// holds a value, with COUNT_SEEN those where it is SHRT_MIN (histograms.OUTSIDE).
#if LANES == 1
#define COUNTERS 256          // items of a work-group that count together; histograms.ValueCounts
#define MOST_VALUES 4096      // of patchmatch.to_grid
#define COUNT(i) atomic_inc(own + (i))
#else
#define COUNTERS 1            // a CPU thread needs no atomics, and its counts fit its cache
#define COUNT(i) own[i]++
#endif
#define COUNT_FREE 1
#define COUNT_SEEN 2
__kernel void histograms_values(const __global short *restrict image, const __global short *restrict marks,
                                __global int *restrict counts, int first, int entries, int width, int height, int at, int which) {
  int item = get_local_id(0), part = get_group_id(0), parts = get_num_groups(0), c = get_global_id(1);
  __global int *sums = counts + ((size_t)part * CHANNELS + c) * entries;
#if LANES == 1
  __local int own[MOST_VALUES];
#else
  __global int *own = sums;
#endif
  for (int i = item; i < entries; i += COUNTERS) own[i] = 0;
#if LANES == 1
  barrier(CLK_LOCAL_MEM_FENCE);
#endif
  for (int y = part; y < height; y += parts) {
    size_t begin = CHANNELS * AT(at + y, 0, width);
    const __global short *row = image + begin + c, *marked = marks + begin;
    for (int x = item; x < width; x += COUNTERS)
      if (!which || (marked[CHANNELS * x] == SHRT_MIN) == (which == COUNT_FREE)) COUNT(row[CHANNELS * x] - first);
  }
#if LANES == 1
  barrier(CLK_LOCAL_MEM_FENCE);
  for (int i = item; i < entries; i += COUNTERS) sums[i] = own[i];
#endif
}

// The sum of the parts, or with `more` this added to `sums`.
__kernel void histograms_values_sum(const __global int *restrict counts, __global uint *restrict sums, int entries, int parts, int more) {
  int i = get_global_id(0), n = CHANNELS * entries;
  if (i >= n) return;
  uint sum = more ? sums[i] : 0;
  for (int part = 0; part < parts; part++) sum += counts[(size_t)part * n + i];
  sums[i] = sum;
}

// Table value -> c' = alpha G^-1(F(c)) + (1 - alpha) c of each channel (MJH17 section 4.2), from the counts of F and G.
// Blending values at equal shares is the same as blending along the x axis of the cumulatives. A work-group makes the
// table of a channel, each item a run of it. Shares are compared in integers.
__kernel void histograms_matching(const __global uint *restrict counts, const __global uint *restrict goal,
                                  __global short *restrict table, int first, int entries, float alpha) {
  int item = get_local_id(0), c = get_global_id(1), run = (entries + COUNTERS - 1) / COUNTERS;
  int begin = item * run < entries ? item * run : entries, end = begin + run < entries ? begin + run : entries;
  const __global uint *own = counts + c * entries, *wanted = goal + c * entries;
  __local uint sums[COUNTERS], goal_sums[COUNTERS];
  uint sum = 0, goal_sum = 0;
  for (int i = begin; i < end; i++) {
    sum += own[i];
    goal_sum += wanted[i];
  }
  sums[item] = sum;
  goal_sums[item] = goal_sum;
  barrier(CLK_LOCAL_MEM_FENCE);
  ulong below = 0, all = 0, of_goal = 0, goal_below = 0;
  for (int i = 0; i < COUNTERS; i++) {
    below += i < item ? sums[i] : 0;
    all += sums[i];
    of_goal += goal_sums[i];
  }
  int at = 0;   // the value of the goal at the same share
  for (int i = begin; i < end; i++) {
    ulong sought = (2 * below + own[i]) * of_goal;   // the middle of this value, of twice `all` times `of_goal`
    while (at % run == 0 && at + run < entries && 2 * all * (goal_below + goal_sums[at / run]) <= sought) {
      goal_below += goal_sums[at / run];
      at += run;
    }
    while (at < entries - 1 && 2 * all * (goal_below + wanted[at]) <= sought) goal_below += wanted[at++];
    float inside = wanted[at] > 0 ? (float)(sought - 2 * all * goal_below) / (float)(2 * all * wanted[at]) : 0.5f;
    float matched = (float)(first + at) - 0.5f + inside;
    float value = alpha * matched + (1.0f - alpha) * (float)(first + i);
    float most = (float)(first + entries - 1);
    value = value < (float)first ? (float)first : value > most ? most : value;
    table[c * entries + i] = (short)rint(value);
    below += own[i];
  }
}

// Point function of a value: one table per channel.
__kernel void histograms_table(const __global short *restrict image, const __global short *restrict table,
                               __global short *restrict matched, int first, int entries, int width, int height) {
  int x = get_global_id(0), y = get_global_id(1);
  if (x >= width || y >= height) return;
  size_t at = CHANNELS * AT(y, x, width);
  for (int c = 0; c < CHANNELS; c++) matched[at + c] = table[c * entries + image[at + c] - first];
}

// --- a sigma for each pixel ---

// Weight of the projection for sigma `k` of `count` at an interpolated position: a tent, in integers.
static inline int share_of(float place, int k) {
  float away = place - (float)k, share = 1.0f - (away < 0.0f ? -away : away);
  return (int)rint(256.0f * (share < 0.0f ? 0.0f : share));
}

// Adds projection `k` to `total`; after the last one `matched` is the blend of all (halves are rounded up). Rows of
// `place` and `matched` from `place_at` and `at` on.
__kernel void histograms_blend(__global short *restrict matched, const __global float *restrict place,
                               __global int *restrict total, int k, int count, int at, int place_at, int width, int height) {
  int x = get_global_id(0), y = get_global_id(1);
  if (x >= width || y >= height) return;
  float own = place[AT(place_at + y, x, width)];
  int share = share_of(own, k), weight = 0;
  for (int j = 0; j < count; j++) weight += share_of(own, j);
  for (int c = 0; c < CHANNELS; c++) {
    size_t i = CHANNELS * AT(at + y, x, width) + c, t = CHANNELS * AT(y, x, width) + c;
    int sum = (k == 0 ? 0 : total[t]) + share * matched[i];
    total[t] = sum;
    if (k < count - 1) continue;
    int doubled = 2 * sum + weight;
    matched[i] = (short)((doubled - (doubled < 0 ? 2 * weight - 1 : 0)) / (2 * weight));
  }
}
