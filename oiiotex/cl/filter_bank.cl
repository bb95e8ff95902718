// Filter responses around every pixel, and their textons: LSA16 section 4.7, labels/filter_bank.py.
//
// Arrays are (layer, row, column). Gaussians sum floats in a fixed order; textons are chosen by integers, so equal
// responses yield equal textons on every device.
#pragma OPENCL FP_CONTRACT OFF
#include "offsets.h"

#define FAR 2147483647

// An item processes WIDE neighbors; rows of layers are padded to a multiple of them.
#if LANES > 1
#define WIDE 8   // columns or pixels per item
typedef float fv __attribute__((ext_vector_type(8), aligned(4)));
typedef int iv __attribute__((ext_vector_type(8)));
typedef short sv __attribute__((ext_vector_type(8), aligned(2)));
typedef uchar ucv __attribute__((ext_vector_type(8), aligned(1)));
#define CONVERTED(v, type) __builtin_convertvector(v, type)
#else
#define WIDE 1
typedef float fv;
typedef int iv;
typedef short sv;
typedef uchar ucv;
#define CONVERTED(v, type) ((type)(v))
#endif
#define SEEN(at) (*(const __global fv *)(at))

// A Gaussian pass along the rows. Rows of `looks` are padded by `radius` pixels on either side; taps[k] is the weight
// at a distance of k pixels.
__kernel void filter_bank_across(const __global float *restrict looks, __global float *restrict across,
                                 __constant float *taps, int radius, int width, int rows) {
  int x = get_global_id(0) * WIDE, y = get_global_id(1);
  if (x >= width || y >= rows) return;
  const __global float *at = looks + AT(y, x + radius, width + 2 * radius);
  fv sum = taps[0] * SEEN(at);
  for (int k = 1; k <= radius; k++) sum += taps[k] * (SEEN(at - k) + SEEN(at + k));
  *(__global fv *)(across + AT(y, x, width)) = sum;
}

// The pass down the columns; `mirrored` maps rows from `radius` above row 0 on to rows of the image.
__kernel void filter_bank_down(const __global float *restrict across, __global float *restrict down,
                               __constant float *taps, const __global int *restrict mirrored, int radius, int width,
                               int height, int layers) {
  int x = get_global_id(0) * WIDE, y = get_global_id(1), layer = get_global_id(2);
  if (x >= width || y >= height || layer >= layers) return;
  const __global float *from = across + AT(layer * height, x, width);
  const __global int *row = mirrored + y + radius;
  fv sum = taps[0] * SEEN(from + AT(y, 0, width));
  for (int k = 1; k <= radius; k++)
    sum += taps[k] * (SEEN(from + AT(row[-k], 0, width)) + SEEN(from + AT(row[k], 0, width)));
  *(__global fv *)(down + AT(layer * height + y, x, width)) = sum;
}

// The center nearest to a pixel's PLANES numbers, ties to the first: by |v - c|^2 - |v|^2, with |c|^2 in `squares` and
// 2 c in `doubled`. The last item reads pixels of the one before again; there are at least WIDE.
__kernel void filter_bank_nearest(const __global short *restrict planes, __constant int *doubled,
                                  __constant int *squares, __global uchar *restrict nearest, int pixels, int count) {
  int own = get_global_id(0) * WIDE, i = own + WIDE > pixels ? pixels - WIDE : own;
  if (own >= pixels) return;
  iv values[PLANES], least = FAR, found = 0;
#pragma unroll
  for (int k = 0; k < PLANES; k++) values[k] = CONVERTED(*(const __global sv *)(planes + AT(k, i, pixels)), iv);
  for (int c = 0; c < count; c++) {
    iv away = squares[c];
#pragma unroll
    for (int k = 0; k < PLANES; k++) away -= values[k] * doubled[PLANES * c + k];
    found = away < least ? (iv)c : found;
    least = away < least ? away : least;
  }
  if (i == own)
    *(__global ucv *)(nearest + i) = CONVERTED(found, ucv);
#if WIDE > 1
  else
    for (; own < pixels; own++) nearest[own] = (uchar)found[own - i];
#endif
}
