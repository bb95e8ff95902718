// Filter responses around every pixel, and their textons: LSA16 section 4.7, labels/filter_bank.py.
//
// Arrays are (layer, row, column). Gaussians sum floats in a fixed order; textons are chosen by integers, so equal
// responses yield equal textons on every device.
#pragma OPENCL FP_CONTRACT OFF
#include "offsets.h"

#define FAR 2147483647

// A Gaussian pass along the rows. Rows of `looks` are padded by `radius` pixels on either side; taps[k] is the weight
// at a distance of k pixels.
__kernel void filter_bank_across(const __global float *restrict looks, __global float *restrict across,
                                 __constant float *taps, int radius, int width, int rows) {
  int x = get_global_id(0), y = get_global_id(1);
  if (x >= width || y >= rows) return;
  const __global float *at = looks + AT(y, x + radius, width + 2 * radius);
  float sum = taps[0] * at[0];
  for (int k = 1; k <= radius; k++) sum += taps[k] * (at[-k] + at[k]);
  across[AT(y, x, width)] = sum;
}

// The pass down the columns; `mirrored` maps rows from `radius` above row 0 on to rows of the image.
__kernel void filter_bank_down(const __global float *restrict across, __global float *restrict down,
                               __constant float *taps, const __global int *restrict mirrored, int radius, int width,
                               int height, int layers) {
  int x = get_global_id(0), y = get_global_id(1), layer = get_global_id(2);
  if (x >= width || y >= height || layer >= layers) return;
  const __global float *from = across + AT(layer * height, x, width);
  const __global int *row = mirrored + y + radius;
  float sum = taps[0] * from[AT(y, 0, width)];
  for (int k = 1; k <= radius; k++) sum += taps[k] * (from[AT(row[-k], 0, width)] + from[AT(row[k], 0, width)]);
  down[AT(layer * height + y, x, width)] = sum;
}

// The center nearest to a pixel's PLANES numbers, ties to the first: by |v - c|^2 - |v|^2, with |c|^2 in `squares` and
// 2 c in `doubled`.
__kernel void filter_bank_nearest(const __global short *restrict planes, __constant int *doubled,
                                  __constant int *squares, __global uchar *restrict nearest, int pixels, int count) {
  int i = get_global_id(0);
  if (i >= pixels) return;
  int values[PLANES];
  for (int k = 0; k < PLANES; k++) values[k] = planes[AT(k, i, pixels)];
  int least = FAR, found = 0;
  for (int c = 0; c < count; c++) {
    int away = squares[c];
    for (int k = 0; k < PLANES; k++) away -= values[k] * doubled[PLANES * c + k];
    found = away < least ? c : found;
    least = away < least ? away : least;
  }
  nearest[i] = (uchar)found;
}
