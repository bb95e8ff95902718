// Feature vectors of superpixels: labels/features.py. Only integers.
#pragma OPENCL FP_CONTRACT OFF
#include "exponential.h"
#include "offsets.h"

#define WHOLE 4096   // fixed-point 1 of a weight: features.py
typedef int i4 __attribute__((ext_vector_type(4), aligned(4)));

// Counts of superpixels, plus those of neighbors weighted by a Gaussian of their distance. `places` are (x, y) along the
// longer side, `first` and `last` the range of near ones along it; rows of counts are padded to 4.
__kernel void features_pool(const __global int2 *restrict places, const __global int *restrict first,
                            const __global int *restrict last, const __global int *restrict counts,
                            __global int *restrict pooled, int superpixels, int width, int reach, float sharpness) {
  int i = get_global_id(0);
  if (i >= superpixels) return;
  __global int *into = pooled + AT(i, 0, width);
  for (int k = 0; k < width; k += 4) *(__global i4 *)(into + k) = 0;
  for (int j = first[i]; j < last[i]; j++) {
    int x = places[j].x - places[i].x, y = places[j].y - places[i].y;
    if (x < -reach || x > reach || y < -reach || y > reach || x * x + y * y > reach * reach) continue;
    int weight = (int)(exponential(-((float)(x * x + y * y) * sharpness)) * WHOLE + 0.5f);
    const __global int *from = counts + AT(j, 0, width);
    for (int k = 0; k < width; k += 4) *(__global i4 *)(into + k) += weight * *(const __global i4 *)(from + k);
  }
}
