// Toroidal PatchMatch on Lab rounded to an integer grid: MJH17 section 4.2, after BSFG09.
//
// A patch is named by its top-left pixel. The field holds, for the patch at (x, y) of the target, its match in
// the exemplar as (ey << 16 | ex). Images are rows of interleaved 16-bit values, CHANNELS to a pixel: L, a, b, and those
// of further maps of the same material. The target is padded at its right and bottom by PATCH - 1 wrapped pixels, so
// that no distance needs a modulo.
// All costs are integers: no order of summation, width of registers or device changes a decision.
#include "lanes.h"
#include "hash.h"

#ifndef CHANNELS
#define CHANNELS 3
#endif
#define ROW (CHANNELS * PATCH)

inline uint corner(int y, int x) { return (uint)y << 16 | (uint)x; }
inline int corner_y(uint c) { return (int)(c >> 16); }
inline int corner_x(uint c) { return (int)(c & 0xffffu); }

// Sum of squared differences of two patches, the inner integral of MJH17 eq. 5. Past `limit` the exact value
// does not matter to any caller, so it stops there.
#if LANES == 1
inline int patch_distance(const __global short *t, int t_row, const __global short *e, int e_row, int limit) {
  int sum = 0;
  for (int r = 0; r < PATCH && sum < limit; r++, t += t_row, e += e_row)
    for (int k = 0; k < ROW; k++) {
      int d = t[k] - e[k];
      sum += d * d;
    }
  return sum;
}
#else
// Rows are cut into the widest registers that fit; the totals across a register are taken only after three rows
// (most hopeless candidates end there) and at the end.
#define WIDE(TYPE, at) (*(const __global TYPE *)(t + (at)) - *(const __global TYPE *)(e + (at)))
inline int patch_distance(const __global short *t, int t_row, const __global short *e, int e_row, int limit) {
#if LANES > 16
  lane_i16 s32 = 0;
#endif
  lane_i8 s16 = 0;
  lane_i4 s8 = 0;
  int s1 = 0, sum = 0;
  for (int r = 0; r < PATCH; r++, t += t_row, e += e_row) {
    int k = 0;
#if LANES > 16
    for (; k + 32 <= ROW; k += 32) s32 += squares32(WIDE(lane_s32, k));
#endif
    for (; k + 16 <= ROW; k += 16) s16 += squares16(WIDE(lane_s16, k));
    for (; k + 8 <= ROW; k += 8) s8 += squares8(WIDE(lane_s8, k));
    for (; k < ROW; k++) {
      int d = t[k] - e[k];
      s1 += d * d;
    }
    if (r == 2 || r == PATCH - 1) {
      sum = s1 + total4(s8) + total8(s16);
#if LANES > 16
      sum += total16(s32);
#endif
      if (sum >= limit) return sum;
    }
  }
  return sum;
}
#endif

// The target with PATCH - 1 wrapped columns and rows appended.
__kernel void patchmatch_pad(const __global short *restrict image, __global short *restrict padded, int width, int height) {
  int x = get_global_id(0), y = get_global_id(1), stride = width + PATCH - 1;
  if (x >= stride || y >= height + PATCH - 1) return;
  const __global short *from = image + CHANNELS * ((y < height ? y : y - height) * width + (x < width ? x : x - width));
  __global short *to = padded + CHANNELS * (y * stride + x);
  for (int c = 0; c < CHANNELS; c++) to[c] = from[c];
}

// Distances of the present field.
__kernel void patchmatch_score(const __global short *restrict target, const __global short *restrict exemplar,
                               const __global uint *restrict field, __global int *restrict distance,
                               int columns, int rows, int t_width, int e_width) {
  int x = get_global_id(0), y = get_global_id(1);
  if (x >= columns || y >= rows) return;
  uint at = field[y * columns + x];
  distance[y * columns + x] = patch_distance(target + CHANNELS * (y * t_width + x), CHANNELS * t_width,
      exemplar + CHANNELS * (corner_y(at) * e_width + corner_x(at)), CHANNELS * e_width, INT_MAX);
}

// A match with its distance, and its cost: the distance plus the penalty of the exemplar patch.
typedef struct { uint at; int distance, cost; } match;

inline match present_match(uint at, int distance, const __global int *penalty, int e_columns) {
  match found = {at, distance, add_sat(distance, penalty[corner_y(at) * e_columns + corner_x(at)])};
  return found;
}

// The better of `best` and the exemplar patch at (ex, ey). A tie keeps `best`.
inline match better_match(match best, int ex, int ey, const __global short *patch, int t_width,
                          const __global short *exemplar, const __global int *penalty, int e_columns, int e_width) {
  int extra = penalty[ey * e_columns + ex];
  if (extra >= best.cost || corner(ey, ex) == best.at) return best;
  int d = patch_distance(patch, CHANNELS * t_width, exemplar + CHANNELS * (ey * e_width + ex), CHANNELS * e_width, best.cost - extra);
  if (d >= best.cost - extra) return best;
  match found = {corner(ey, ex), d, d + extra};
  return found;
}

// One Jacobi pass of propagation: every patch is offered the matches of its four neighbours `jump` pixels away,
// shifted back. Columns and rows of the field wrap where the target does (MJH17 section 4.2, toroidal boundary
// conditions).
__kernel void patchmatch_propagate(const __global short *restrict target, const __global short *restrict exemplar,
                                   const __global int *restrict penalty,
                                   const __global uint *restrict field, const __global int *restrict distance,
                                   __global uint *restrict field_out, __global int *restrict distance_out,
                                   int columns, int rows, int t_width, int e_columns, int e_rows, int e_width,
                                   int jump, int wrap_x, int wrap_y) {
  int x = get_global_id(0), y = get_global_id(1);
  if (x >= columns || y >= rows) return;
  int p = y * columns + x;
  const __global short *patch = target + CHANNELS * (y * t_width + x);
  match best = present_match(field[p], distance[p], penalty, e_columns);
  for (int k = 0; k < 4; k++) {
    int dx = k == 0 ? -jump : k == 1 ? jump : 0, dy = k == 2 ? -jump : k == 3 ? jump : 0;
    int nx = x + dx, ny = y + dy;
    if (nx < 0 || nx >= columns) {
      if (!wrap_x) continue;
      nx += nx < 0 ? columns : -columns;
    }
    if (ny < 0 || ny >= rows) {
      if (!wrap_y) continue;
      ny += ny < 0 ? rows : -rows;
    }
    uint other = field[ny * columns + nx];
    int ex = corner_x(other) - dx, ey = corner_y(other) - dy;
    if (ex < 0 || ey < 0 || ex >= e_columns || ey >= e_rows) continue;
    best = better_match(best, ex, ey, patch, t_width, exemplar, penalty, e_columns, e_width);
  }
  field_out[p] = best.at;
  distance_out[p] = best.distance;
}

// Random search: one candidate in each of `searches` windows around the best so far, shrinking from the whole
// exemplar to about two pixels (BSFG09 section 3.2, exponential decay).
__kernel void patchmatch_search(const __global short *restrict target, const __global short *restrict exemplar,
                                const __global int *restrict penalty,
                                __global uint *restrict field, __global int *restrict distance,
                                int columns, int rows, int t_width, int e_columns, int e_rows, int e_width,
                                __constant int *radius, int searches, uint seed, uint step) {
  int x = get_global_id(0), y = get_global_id(1);
  if (x >= columns || y >= rows) return;
  int p = y * columns + x;
  const __global short *patch = target + CHANNELS * (y * t_width + x);
  match best = present_match(field[p], distance[p], penalty, e_columns);
  uint bits = hash_at(seed, step, y, x);
  for (int k = 0; k < searches; k++) {
    int r = radius[k], bx = corner_x(best.at), by = corner_y(best.at);
    int x0 = bx > r ? bx - r : 0, x1 = bx + r < e_columns ? bx + r : e_columns - 1;
    int y0 = by > r ? by - r : 0, y1 = by + r < e_rows ? by + r : e_rows - 1;
    bits = hash_pcg(bits + 2u * (uint)k + 1u);
    int ex = x0 + hash_below(bits, x1 - x0 + 1);
    bits = hash_pcg(bits + 2u * (uint)k + 2u);
    int ey = y0 + hash_below(bits, y1 - y0 + 1);
    best = better_match(best, ex, ey, patch, t_width, exemplar, penalty, e_columns, e_width);
  }
  field[p] = best.at;
  distance[p] = best.distance;
}

// --- spatial uniformity (MJH17 eq. 6, after KNL*15) ---

// How often each exemplar patch is used by the field.
__kernel void patchmatch_count(const __global uint *restrict field, __global int *restrict count, int patches, int e_columns) {
  int p = get_global_id(0);
  if (p >= patches) return;
  atomic_inc(count + corner_y(field[p]) * e_columns + corner_x(field[p]));
}

// Uses of an exemplar pixel are the counts summed over the PATCH x PATCH patches that cover it; their mean over a
// patch sums once more. Both box sums together are one separable triangle of width 2 PATCH - 1: along rows here,
inline int triangle(const __global int *count, int at, int n, int stride) {
  int sum = 0;
  for (int k = 1; k <= PATCH; k++) {   // the rising side, with its peak, and the falling one
    int before = at - PATCH + k, after = at + PATCH - k;
    if (before >= 0) sum += k * count[before * stride];
    if (k < PATCH && after < n) sum += k * count[after * stride];
  }
  return sum;
}
__kernel void patchmatch_uses_rows(const __global int *restrict count, __global int *restrict uses, int e_columns, int e_rows) {
  int x = get_global_id(0), y = get_global_id(1);
  if (x >= e_columns || y >= e_rows) return;
  uses[y * e_columns + x] = triangle(count + y * e_columns, x, e_columns, 1);
}
// and along columns here, where the sum becomes the penalty of choosing the patch: `price` times what it costs others
// that are used as often. A patch that must not be chosen (it covers a transparent pixel) has a negative price.
__kernel void patchmatch_penalty(const __global int *restrict uses, const __global float *restrict price,
                                 __global int *restrict penalty, int e_columns, int e_rows, float weight) {
  int x = get_global_id(0), y = get_global_id(1), p = y * e_columns + x;
  if (x >= e_columns || y >= e_rows) return;
  float cost = weight * (float)triangle(uses + x, y, e_rows, e_columns) * price[p];
  penalty[p] = price[p] < 0.0f ? INT_MAX : cost < 1.0e9f ? (int)cost : 1000000000;
}

// --- voting ---

// Every target pixel becomes the mean of what the patches over it say, rounded to the grid (halves go up).
inline short mean_vote(int sum, int votes) {
  const int above = 4096;   // keeps the dividend positive, where C's division rounds down
  return (short)((2 * (sum + above * votes) + votes) / (2 * votes) - above);
}

// Patches from first to last cover pixel `at`; where the field wraps all PATCH do.
#define FIRST(at, wrap) ((wrap) || (at) >= PATCH ? (at) - PATCH + 1 : 0)
#define LAST(at, n, wrap) ((wrap) || (at) < (n) ? (at) : (n) - 1)
#define WRAPPED(i, n) ((i) < 0 ? (i) + (n) : (i) >= (n) ? (i) - (n) : (i))

#if LANES == 1
__kernel void patchmatch_vote(const __global short *restrict exemplar, const __global uint *restrict field,
                              __global short *restrict image, int columns, int rows, int width, int height,
                              int e_width, int wrap_x, int wrap_y) {
  int x = get_global_id(0), y = get_global_id(1);
  if (x >= width || y >= height) return;
  int sum[CHANNELS] = {0}, votes = 0;
  for (int v = FIRST(y, wrap_y); v <= LAST(y, rows, wrap_y); v++)
    for (int u = FIRST(x, wrap_x); u <= LAST(x, columns, wrap_x); u++, votes++) {
      uint at = field[WRAPPED(v, rows) * columns + WRAPPED(u, columns)];
      const __global short *e = exemplar + CHANNELS * ((corner_y(at) + y - v) * e_width + corner_x(at) + x - u);
      for (int c = 0; c < CHANNELS; c++) sum[c] += e[c];
    }
  for (int c = 0; c < CHANNELS; c++) image[CHANNELS * (y * width + x) + c] = mean_vote(sum[c], votes);
}
#else
// One item makes SPAN pixels of a row. The patches of one field column that cover the row vote for the same
// PATCH pixels, so their exemplar rows are summed in registers and added to the span once.
#define SPAN 64
__kernel void patchmatch_vote(const __global short *restrict exemplar, const __global uint *restrict field,
                              __global short *restrict image, int columns, int rows, int width, int height,
                              int e_width, int wrap_x, int wrap_y) {
  int x0 = get_global_id(0) * SPAN, y = get_global_id(1);
  if (x0 >= width || y >= height) return;
  int sum[CHANNELS * (SPAN + 2 * PATCH)];
  for (int i = 0; i < CHANNELS * (SPAN + 2 * PATCH); i++) sum[i] = 0;
  int x1 = x0 + SPAN < width ? x0 + SPAN : width;
  int first = FIRST(y, wrap_y), last = LAST(y, rows, wrap_y);
  for (int u = FIRST(x0, wrap_x); u <= LAST(x1 - 1, columns, wrap_x); u++) {
    const __global uint *matches = field + WRAPPED(u, columns);
    short row[ROW];
    for (int k = 0; k < ROW; k++) row[k] = 0;
    for (int v = first; v <= last; v++) {
      uint at = matches[WRAPPED(v, rows) * columns];
      const __global short *e = exemplar + CHANNELS * ((corner_y(at) + y - v) * e_width + corner_x(at));
      for (int k = 0; k < ROW; k++) row[k] += e[k];   // fits 16 bits: see patchmatch.grid_steps
    }
    int *into = sum + CHANNELS * (u - x0 + PATCH);
    for (int k = 0; k < ROW; k++) into[k] += row[k];
  }
  for (int x = x0; x < x1; x++) {
    int votes = (last - first + 1) * (LAST(x, columns, wrap_x) - FIRST(x, wrap_x) + 1);
    for (int c = 0; c < CHANNELS; c++)
      image[CHANNELS * (y * width + x) + c] = mean_vote(sum[CHANNELS * (x - x0 + PATCH) + c], votes);
  }
}
#endif

// The last vote picks, for every target pixel, the exemplar pixel with the most votes; a patch votes the stronger
// the nearer its centre lies. Means would blur here (MJH17 section 4.2: the original pixel values of the source
// make the final image). Ties go to the lower address.
__kernel void patchmatch_pick(const __global uint *restrict field, __constant int *weight, __global uint *restrict source,
                              int columns, int rows, int width, int height, int wrap_x, int wrap_y) {
  int x = get_global_id(0), y = get_global_id(1);
  if (x >= width || y >= height) return;
  uint choice[PATCH * PATCH];
  int votes[PATCH * PATCH], n = 0;
  for (int v = FIRST(y, wrap_y); v <= LAST(y, rows, wrap_y); v++)
    for (int u = FIRST(x, wrap_x); u <= LAST(x, columns, wrap_x); u++) {
      uint pixel = field[WRAPPED(v, rows) * columns + WRAPPED(u, columns)] + corner(y - v, x - u);
      int k = 0;
      while (k < n && choice[k] != pixel) k++;
      if (k == n) {
        choice[n] = pixel;
        votes[n++] = 0;
      }
      votes[k] += weight[(y - v) * PATCH + x - u];
    }
  int best = 0;
  for (int k = 1; k < n; k++)
    if (votes[k] > votes[best] || (votes[k] == votes[best] && choice[k] < choice[best])) best = k;
  source[y * width + x] = choice[best];
}

// --- pixels that stay ---

// Puts back what a target must show. `held` holds SHRT_MIN (histograms.OUTSIDE) where it is free.
__kernel void patchmatch_hold(const __global short *restrict held, __global short *restrict image, int pixels) {
  int p = get_global_id(0);
  if (p >= pixels || held[CHANNELS * p] == SHRT_MIN) return;
  for (int c = 0; c < CHANNELS; c++) image[CHANNELS * p + c] = held[CHANNELS * p + c];
}

// Takes back a change near the pixels that stay: `changed` becomes share / 255 of the way from `image` to it.
__kernel void patchmatch_ease(const __global short *restrict image, __global short *restrict changed,
                              const __global uchar *restrict share, int pixels) {
  int p = get_global_id(0);
  if (p >= pixels) return;
  for (int c = 0; c < CHANNELS; c++) {
    int from = image[CHANNELS * p + c], far = (changed[CHANNELS * p + c] - from) * share[p];
    changed[CHANNELS * p + c] = (short)(from + (far + (far < 0 ? -127 : 127)) / 255);
  }
}
