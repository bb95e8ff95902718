// Steerable filters of MJH17 eq. 4 and their inverse (section 4.3), defined in stationarity/steerable.py.
//
// Images are interleaved, so a row is CHANNELS * width values and taps are CHANNELS values apart. `rows` holds four
// planes of floats, one per order of the derivative along x. A band stores the signed square root of a response: a
// histogram of roots has fine bins for small responses, and matching does not depend on the spacing of values.
// An item computes WIDE neighboring values; all widths use the same sums in the same order.
//
// Buffers may hold bands of rows. A kernel computes `count` rows from row `top` of the image on, counted beyond its border
// if it wraps; `first` is the first row of buffers that are also read above and below. Results and pointwise inputs begin
// at row 0 of their buffers, but images at row `at` and the residual at row `rest_at`; planes of floats have `held` rows.
#pragma OPENCL FP_CONTRACT OFF

#include "offsets.h"

#define OUTSIDE SHRT_MIN   // histograms.OUTSIDE: not a pixel of the image; filters over it have no response
#define TAPS (2 * RADIUS + 1)
#if LANES > 1
#define WIDE 16
typedef float wide __attribute__((ext_vector_type(16), aligned(4)));
typedef int wide_int __attribute__((ext_vector_type(16)));
typedef short wide_short __attribute__((ext_vector_type(16), aligned(2)));
#define CONVERTED(v, type) __builtin_convertvector(v, type)
#define LANE(v, k) (v)[k]
#else
#define WIDE 1
typedef float wide;
typedef int wide_int;
typedef short wide_short;
#define CONVERTED(v, type) ((type)(v))
#define LANE(v, k) (v)
#endif

// Coordinates beyond the border are wrapped, or mirrored about the border pixel.
static inline int within(int i, int n, int wrap) {
  if (i >= 0 && i < n) return i;
  int period = wrap ? n : 2 * n - 2;
  i %= period;
  i = i < 0 ? i + period : i;
  return i < n ? i : period - i;
}

// Row y of the image within the rows held from `first` on.
static inline int held_row(int y, int first, int height, int wrap) {
  return within((wrap ? y : within(y, height, 0)) - first, height, 1);
}

// Index of value i of a row moved by `step` pixels; the last value is repeated after the row.
static inline int moved(int i, int step, int width, int wrap) {
  i = i < CHANNELS * width ? i : CHANNELS * width - 1;
  return CHANNELS * within(i / CHANNELS + step, width, wrap) + i % CHANNELS;
}

static inline wide_short read_short(const __global short *row, int i, int step, int width, int wrap) {
  int at = i + CHANNELS * step;
  if (at >= 0 && at + WIDE <= CHANNELS * width) return *(const __global wide_short *)(row + at);
  wide_short v = 0;
  for (int k = 0; k < WIDE; k++) LANE(v, k) = row[moved(i + k, step, width, wrap)];
  return v;
}

static inline wide read_float(const __global float *row, int i, int step, int width, int wrap) {
  int at = i + CHANNELS * step;
  if (at >= 0 && at + WIDE <= CHANNELS * width) return *(const __global wide *)(row + at);
  wide v = 0.0f;
  for (int k = 0; k < WIDE; k++) LANE(v, k) = row[moved(i + k, step, width, wrap)];
  return v;
}

static inline void write_short(__global short *row, int i, int n, wide_short v) {
  if (i + WIDE <= n) *(__global wide_short *)(row + i) = v;
  else for (int k = 0; i + k < n; k++) row[i + k] = LANE(v, k);
}

static inline void write_float(__global float *row, int i, int n, wide v) {
  if (i + WIDE <= n) *(__global wide *)(row + i) = v;
  else for (int k = 0; i + k < n; k++) row[i + k] = LANE(v, k);
}

// All four derivatives along x; NaN if a tap reads OUTSIDE, which propagates.
__kernel void steerable_rows(const __global short *restrict image, __global float *restrict rows,
                             __constant float *taps, int count, int held, int width, int wrap) {
  int i = get_global_id(0) * WIDE, y = get_global_id(1), n = CHANNELS * width;
  if (i >= n || y >= count) return;
  wide sum[4] = {0.0f, 0.0f, 0.0f, 0.0f};
  for (int t = 0; t < TAPS; t++) {
    wide_int v = CONVERTED(read_short(image + AT(y, 0, n), i, t - RADIUS, width, wrap), wide_int);
    wide f = v == OUTSIDE ? (wide)NAN : CONVERTED(v, wide);
    for (int k = 0; k < 4; k++) sum[k] += taps[k * TAPS + t] * f;
  }
  for (int k = 0; k < 4; k++) write_float(rows + AT(AT(k, y, held), 0, n), i, n, sum[k]);
}

// The derivatives along y, steered to the four orientations (F_o * f of MJH17 eq. 4), as roots.
__kernel void steerable_columns(const __global float *restrict rows, __global short *restrict band0,
                                __global short *restrict band1, __global short *restrict band2,
                                __global short *restrict band3, __constant float *taps, __constant float *angular,
                                float scale, int top, int count, int first, int held, int width, int height, int wrap) {
  int i = get_global_id(0) * WIDE, y = get_global_id(1), n = CHANNELS * width;
  if (i >= n || y >= count) return;
  wide sum[4] = {0.0f, 0.0f, 0.0f, 0.0f};
  for (int t = 0; t < TAPS; t++) {
    int at = held_row(top + y + t - RADIUS, first, height, wrap);
    for (int k = 0; k < 4; k++)
      sum[k] += taps[(3 - k) * TAPS + t] * read_float(rows + AT(AT(k, at, held), 0, n), i, 0, width, 0);
  }
  __global short *bands[4] = {band0, band1, band2, band3};
  for (int o = 0; o < 4; o++) {
    wide v = 0.0f;
    for (int k = 0; k < 4; k++) v += angular[4 * o + k] * sum[k];
    wide root = 0.0f;   // one by one: some runtimes cannot compile sqrt of a vector
    for (int k = 0; k < WIDE; k++) LANE(root, k) = sqrt(LANE(v, k) < 0.0f ? -LANE(v, k) : LANE(v, k));
    root = root * scale + 0.5f;
    wide_int whole = CONVERTED(v != v ? (wide)0.0f : root, wide_int);
    whole = v != v ? (wide_int)OUTSIDE : v < 0.0f ? -whole : whole;
    write_short(bands[o] + AT(y, 0, n), i, n, CONVERTED(whole, wide_short));
  }
}

// The response of a stored root; 0 for OUTSIDE.
static inline wide response(wide_short root, float unit) {
  wide_int v = CONVERTED(root, wide_int);
  wide f = CONVERTED(v, wide), squared = f * f * unit;
  return v == OUTSIDE ? (wide)0.0f : f < 0.0f ? -squared : squared;
}

// MJH17 section 4.3, after Heeger and Bergen: the transposed filters, weighted by responses, first along y. With
// `changes` the weights are the changes by matching, else the responses themselves.
__kernel void steerable_spread(const __global short *restrict before0, const __global short *restrict before1,
                               const __global short *restrict before2, const __global short *restrict before3,
                               const __global short *restrict after0, const __global short *restrict after1,
                               const __global short *restrict after2, const __global short *restrict after3,
                               __global float *restrict rows, __constant float *taps, __constant float *angular,
                               float unit, int changes, int top, int count, int first, int held,
                               int width, int height, int wrap) {
  int i = get_global_id(0) * WIDE, y = get_global_id(1), n = CHANNELS * width;
  if (i >= n || y >= count) return;
  const __global short *before[4] = {before0, before1, before2, before3}, *after[4] = {after0, after1, after2, after3};
  wide sum[4] = {0.0f, 0.0f, 0.0f, 0.0f};
  for (int t = 0; t < TAPS; t++) {
    size_t at = AT(held_row(top + y + t - RADIUS, first, height, wrap), 0, n);
    wide d[4];
    for (int o = 0; o < 4; o++) {
      wide_short root = read_short(before[o] + at, i, 0, width, 0);
      d[o] = response(root, unit);
      if (!changes) continue;
      wide_short matched = read_short(after[o] + at, i, 0, width, 0);
      wide_int seen = CONVERTED(root, wide_int);
      d[o] = seen == OUTSIDE ? (wide)0.0f : response(matched, unit) - d[o];
    }
    for (int k = 0; k < 4; k++)
      sum[k] += taps[(3 - k) * TAPS + t] *
                (angular[k] * d[0] + angular[4 + k] * d[1] + angular[8 + k] * d[2] + angular[12 + k] * d[3]);
  }
  for (int k = 0; k < 4; k++) write_float(rows + AT(AT(k, y, held), 0, n), i, n, sum[k]);
}

// Then along x. The filters are odd, so their transposes have the opposite sign.
static inline wide spread_along_x(const __global float *rows, __constant float *taps, int i, int y, int width, int held, int wrap) {
  wide sum = 0.0f;
  for (int k = 0; k < 4; k++)
    for (int t = 0; t < TAPS; t++)
      sum -= taps[k * TAPS + t] * read_float(rows + AT(AT(k, y, held), 0, CHANNELS * width), i, t - RADIUS, width, wrap);
  return sum;
}

// Round to nearest: the shifted value is positive, and C's conversion rounds towards zero.
static inline wide_short rounded(wide v) { return CONVERTED(CONVERTED(v + 32768.5f, wide_int) - 32768, wide_short); }

// The residual: the image minus the reconstruction from its responses. All residuals of the pyramid in one.
__kernel void steerable_rest(const __global short *restrict image, const __global float *restrict rows,
                             __global short *restrict rest, __constant float *taps, int at, int count, int held,
                             int width, int wrap) {
  int i = get_global_id(0) * WIDE, y = get_global_id(1), n = CHANNELS * width;
  if (i >= n || y >= count) return;
  wide_int v = CONVERTED(read_short(image + AT(at + y, 0, n), i, 0, width, 0), wide_int);
  wide left = CONVERTED(v, wide) - spread_along_x(rows, taps, i, y, width, held, wrap);
  left = v == OUTSIDE ? (wide)OUTSIDE : left;
  write_short(rest + AT(y, 0, n), i, n, rounded(left));
}

// The image plus `strength` times the reconstructed changes of its responses and of the residual.
__kernel void steerable_add(const __global short *restrict image, const __global float *restrict rows,
                            const __global short *restrict rest, const __global short *restrict rest_matched,
                            __global short *restrict matched, __constant float *taps, __constant float *low,
                            __constant float *high, float strength, int at, int rest_at, int count, int held,
                            int width, int wrap) {
  int i = get_global_id(0) * WIDE, y = get_global_id(1), n = CHANNELS * width;
  if (i >= n || y >= count) return;
  wide least = 0.0f, most = 0.0f;
  for (int k = 0; k < WIDE; k++) {
    LANE(least, k) = low[(i + k) % CHANNELS];
    LANE(most, k) = high[(i + k) % CHANNELS];
  }
  wide moved = CONVERTED(read_short(rest_matched + AT(rest_at + y, 0, n), i, 0, width, 0), wide) -
               CONVERTED(read_short(rest + AT(rest_at + y, 0, n), i, 0, width, 0), wide);
  wide v = CONVERTED(read_short(image + AT(at + y, 0, n), i, 0, width, 0), wide) +
           strength * (spread_along_x(rows, taps, i, y, width, held, wrap) + moved);
  v = v < least ? least : v > most ? most : v;
  write_short(matched + AT(at + y, 0, n), i, n, rounded(v));
}
