// Matrix products of a random walk, and gradient descent of its factors: LSA16 sections 4.2 and 4.4,
// labels/random_walk.py and labels/stochastic_nmf.py. Matrices are row-major, with rows padded to 8 columns.
//
// Floats are summed in a fixed order, also across eight lanes: the same bits on every device.
#pragma OPENCL FP_CONTRACT OFF
#include "lanes.h"
#include "offsets.h"

#if LANES > 1
#define WIDE 8   // columns per item
typedef float fv __attribute__((ext_vector_type(8), aligned(4)));
#else
#define WIDE 1
typedef float fv;
#endif
#define COLUMNS(matrix, i, j, stride) (*(__global fv *)((matrix) + AT(i, j, stride)))
#define SEEN(matrix, i, j, stride) (*(const __global fv *)((matrix) + AT(i, j, stride)))
typedef float f8 __attribute__((ext_vector_type(8), aligned(4)));
typedef int i8 __attribute__((ext_vector_type(8)));
#define EIGHT(row, j) (*(__global f8 *)((row) + (j)))

static inline float sum8(f8 v) {
  float a = v.s0 + v.s4, b = v.s1 + v.s5, c = v.s2 + v.s6, d = v.s3 + v.s7;
  return (a + c) + (b + d);
}

// alpha S x + beta x + gamma before, S a sparse matrix by rows; `width` is a multiple of SPREAD * WIDE.
#if LANES > 1
#define SPREAD 6   // an item reads an entry of S once for 48 columns (products.py)
#else
#define SPREAD 1
#endif
__kernel void factorization_spread(const __global int *restrict starts, const __global int *restrict columns,
                                   const __global float *restrict weights, const __global float *restrict x,
                                   const __global float *restrict before, __global float *restrict out, int rows,
                                   int width, float alpha, float beta, float gamma) {
  int blocks = width / (SPREAD * WIDE), i = get_global_id(0) / blocks, j = get_global_id(0) % blocks * SPREAD * WIDE;
  if (i >= rows) return;
  fv sum[SPREAD];
#pragma unroll
  for (int t = 0; t < SPREAD; t++) sum[t] = 0.0f;
  for (int p = starts[i]; p < starts[i + 1]; p++)
#pragma unroll
    for (int t = 0; t < SPREAD; t++) sum[t] += weights[p] * SEEN(x, columns[p], j + t * WIDE, width);
#pragma unroll
  for (int t = 0; t < SPREAD; t++) {
    int k = j + t * WIDE;
    COLUMNS(out, i, k, width) = (alpha * sum[t] + beta * SEEN(x, i, k, width)) + gamma * SEEN(before, i, k, width);
  }
}

// S x, x a vector.
__kernel void factorization_step(const __global int *restrict starts, const __global int *restrict columns,
                                 const __global float *restrict weights, const __global float *restrict x,
                                 __global float *restrict out, int rows) {
  int i = get_global_id(0);
  if (i >= rows) return;
  f8 sum = 0.0f;
  int p = starts[i], end = starts[i + 1];
  for (; p + 8 <= end; p += 8) {
    f8 at;
#pragma unroll   // an index that is not constant would put the vector into memory
    for (int t = 0; t < 8; t++) at[t] = x[columns[p + t]];
    sum += *(const __global f8 *)(weights + p) * at;
  }
#pragma unroll
  for (int t = 0; t < 8; t++)
    if (p + t < end) sum[t] += weights[p + t] * x[columns[p + t]];
  out[i] = sum8(sum);
}

// a b, (rows, inner) times (inner, width); a has rows of `stride`.
__kernel void factorization_product(const __global float *restrict a, const __global float *restrict b,
                                    __global float *restrict out, int rows, int inner, int stride, int width) {
  int j = get_global_id(0) * WIDE, i = get_global_id(1);
  if (j >= width || i >= rows) return;
  fv sum = 0.0f;
  for (int k = 0; k < inner; k++) sum += a[AT(i, k, stride)] * SEEN(b, k, j, width);
  COLUMNS(out, i, j, width) = sum;
}

// a^T b, (rows, tall)^T times (rows, width).
__kernel void factorization_gram(const __global float *restrict a, const __global float *restrict b,
                                 __global float *restrict out, int rows, int tall, int width) {
  int j = get_global_id(0) * WIDE, k = get_global_id(1) * WIDE;
  if (j >= width || k >= tall) return;
  fv sum[WIDE];
#pragma unroll
  for (int t = 0; t < WIDE; t++) sum[t] = 0.0f;
  for (int i = 0; i < rows; i++) {
    fv right = SEEN(b, i, j, width);
#pragma unroll   // otherwise sums are in memory
    for (int t = 0; t < WIDE; t++) sum[t] += a[AT(i, k + t, tall)] * right;
  }
  for (int t = 0; t < WIDE; t++) COLUMNS(out, k + t, j, width) = sum[t];
}

// (rows, stride) -> (columns, width): the first `columns` columns as rows, the first `rows` of each filled, then zeros.
__kernel void factorization_transposed(const __global float *restrict matrix, __global float *restrict out, int rows,
                                       int stride, int columns, int width) {
  int j = get_global_id(0), i = get_global_id(1);
  if (j >= width || i >= columns) return;
  out[AT(i, j, width)] = j < rows ? matrix[AT(j, i, stride)] : 0.0f;
}

#define PADDING -1e37f   // no value of a row to project is below -1e20

// Projection to the simplex: the number to subtract so that the positive values sum to 1 (Michelot 1986); `inverse[n]`
// is 1 / n.
static inline float threshold_of(const __global float *row, const __global float *inverse, int width) {
  float threshold = -1e20f;
  for (int before = width + 1;;) {   // until the number of positive values does not change
    f8 sum = 0.0f;
    int now = 0;
#if LANES > 1
    i8 above = 0;
    for (int j = 0; j < width; j += 8) {
      f8 v = *(const __global f8 *)(row + j);
      sum += v > threshold ? v : (f8)0.0f;
      above -= v > threshold;
    }
    now = total8(above);
#else   // the same order; Oclgrind compares vectors differently
    for (int j = 0; j < width; j += 8)
      for (int t = 0; t < 8; t++) {
        float v = row[j + t];
        sum[t] += v > threshold ? v : 0.0f;
        now += v > threshold;
      }
#endif
    if (now >= before || now == 0) return threshold;
    before = now;
    threshold = (sum8(sum) - 1.0f) * inverse[now];
  }
}

// Each row x of `at`, on the simplex, is moved to the minimum of x Q x^T / 2 - x c^T, c its row of `linear`, by FISTA
// (Beck and Teboulle 2009) with adaptive restart per row (O'Donoghue and Candes 2015). `ahead` holds two rows for each.
__kernel void factorization_memberships(const __global float *restrict quadratic, const __global float *restrict linear,
                                        const __global float *restrict inverse, const __global float *restrict momentum,
                                        __global float *restrict at, __global float *restrict scratch, int rows,
                                        int labels, int width, int steps, float step, float settled) {
  int i = get_global_id(0);
  if (i >= rows) return;
  __global float *x = at + AT(i, 0, width), *ahead = scratch + AT(2 * i, 0, width), *trial = ahead + width;
  const __global float *c = linear + AT(i, 0, width);
  for (int j = 0; j < width; j += 8) EIGHT(ahead, j) = EIGHT(x, j);
  for (int n = 0, age = 0; n < steps; n++) {
    for (int j = 0; j < width; j += 8) EIGHT(trial, j) = 0.0f;
    for (int k = 0; k < labels; k++) {
      float share = ahead[k];
      if (share != 0.0f)   // most are 0
        for (int j = 0; j < width; j += 8)
          EIGHT(trial, j) += share * *(const __global f8 *)(quadratic + AT(k, j, width));
    }
    for (int j = 0; j < width; j += 8)
      EIGHT(trial, j) = EIGHT(ahead, j) - step * (EIGHT(trial, j) - *(const __global f8 *)(c + j));
    for (int j = labels; j < width; j++) trial[j] = PADDING;
    float threshold = threshold_of(trial, inverse, width);
    f8 turned = 0.0f, most = 0.0f;
    for (int j = 0; j < width; j += 8) {
      f8 over = EIGHT(trial, j) - threshold, to = over > 0.0f ? over : (f8)0.0f, moved = to - EIGHT(x, j);
      f8 far = moved < 0.0f ? -moved : moved;
      turned += (EIGHT(ahead, j) - to) * moved;
      most = far > most ? far : most;
      EIGHT(x, j) = to;
      EIGHT(trial, j) = moved;
    }
    age = sum8(turned) > 0.0f ? 0 : age + 1;
    for (int j = 0; j < width; j += 8) EIGHT(ahead, j) = EIGHT(x, j) + momentum[age] * EIGHT(trial, j);
    int still = 1;
    for (int t = 0; t < 8; t++) still &= most[t] < settled;
    if (still) return;
  }
}

// A gradient step for tr(X^T Q X) / 2 - tr(X^T C), X (labels, width).
__kernel void factorization_advance(const __global float *restrict quadratic, const __global float *restrict linear,
                                    const __global float *restrict ahead, __global float *restrict trial, int labels,
                                    int stride, int width, float step) {
  int j = get_global_id(0) * WIDE, i = get_global_id(1);
  if (j >= width || i >= labels) return;
  fv slope = 0.0f;
  for (int k = 0; k < labels; k++) slope += quadratic[AT(i, k, stride)] * SEEN(ahead, k, j, width);
  COLUMNS(trial, i, j, width) = SEEN(ahead, i, j, width) - step * (slope - SEEN(linear, i, j, width));
}

// Project each row of `trial`, (labels, nodes), to the simplex, and extrapolate from its previous position.
__kernel void factorization_project(__global float *restrict trial, const __global float *restrict inverse,
                                    __global float *restrict at, __global float *restrict ahead, int labels, int nodes,
                                    int width, float momentum) {
  int i = get_global_id(0);
  if (i >= labels) return;
  __global float *row = trial + AT(i, 0, width), *x = at + AT(i, 0, width), *next = ahead + AT(i, 0, width);
  for (int j = nodes; j < width; j++) row[j] = PADDING;
  float threshold = threshold_of(row, inverse, width);
  for (int j = 0; j < width; j += 8) {
    f8 over = EIGHT(row, j) - threshold, to = over > 0.0f ? over : (f8)0.0f;
    EIGHT(next, j) = to + momentum * (to - EIGHT(x, j));
    EIGHT(x, j) = to;
  }
}
