// Synthesis on the pixels of a surface: atlas/synthesis.py, after Lefebvre and Hoppe, SIGGRAPH 2006, section 5.
// Only integers. Places in the photo are pairs (x, y) in 1/256 px.
#include "hash.h"
#include "offsets.h"

#define REACH 2
#define SIDE (2 * REACH + 1)
#define AROUND (SIDE * SIDE)
#define OWN (AROUND / 2)
#define CLOSE 9   // neighbors whose copies are tried
#define ONE 256
#define BASIS_BITS 12

typedef int looks16 __attribute__((ext_vector_type(16), aligned(4)));
typedef long wide16 __attribute__((ext_vector_type(16)));
// By Cauchy and Schwarz, sums over 25 * 9 values of 16 bits with a basis of length 4096 fit 32 bits.
#if CHANNELS > 9
typedef long sum_t;
typedef wide16 sum16;
#else
typedef int sum_t;
typedef looks16 sum16;
#endif

// Bits of the neighbors of each pixel that are not in its own chart; others are where those of its face are.
__kernel void atlas_missing(const __global uint *restrict spots, const __global int *restrict face,
                            const __global int *restrict chart, const __global int2 *restrict moves,
                            const __global int *restrict index, __global uint *restrict missing, int count, int width,
                            int height, int around) {
  int i = get_global_id(0);
  if (i >= count) return;
  int own = chart[face[i]];
  uint bits = 0;
  for (int k = 0; k < around; k++) {
    int2 move = moves[AT(face[i], k, around)];
    int x = corner_x(spots[i]) + move.x, y = corner_y(spots[i]) + move.y;
    int there = x >= 0 && x < width && y >= 0 && y < height ? index[AT(y, x, width)] : -1;
    if (there < 0 || chart[face[there]] != own) bits |= 1u << k;
  }
  missing[i] = bits;
}

// The pixel of the photo that contains a place, clamped to the border.
static inline int pixel_at(int2 place, int width, int height) {
  int x = max(0, min(place.x >> 8, width - 1)), y = max(0, min(place.y >> 8, height - 1));
  return y * width + x;
}

// The valid pixel for a place; the place becomes its center if it is another one.
static inline int taken(int2 *place, const __global int *snap, int width, int height) {
  int at = pixel_at(*place, width, height), pixel = snap[at];
  if (pixel != at) *place = (int2)(pixel % width, pixel / width) * ONE + ONE / 2;
  return pixel;
}

static inline long rounded(long value, int bits) {   // value / 2^bits, halves to even
  long low = value >> bits, rest = value - (low << bits), middle = 1L << (bits - 1);
  return low + (rest > middle || (rest == middle && (low & 1)));
}

static inline long distance16(const __global int *looks, int pixel, looks16 wanted) {
#if LANES > 1
  wide16 apart = __builtin_convertvector(*(const __global looks16 *)(looks + AT(pixel, 0, 16)), wide16) -
                 __builtin_convertvector(wanted, wide16);
  wide16 squares = apart * apart;
  long sum = 0;
  for (int d = 0; d < 16; d++) sum += squares[d];
  return sum;
#else
  long sum = 0;
#pragma unroll
  for (int d = 0; d < 16; d++) {
    long apart = (long)looks[AT(pixel, d, 16)] - wanted[d];
    sum += apart * apart;
  }
  return sum;
#endif
}

// For each of the `chosen` pixels the best source: one that a neighbor's copy continues with, or a random one.
// `table` holds of each pixel the row of its neighbors in `neighbors` and `rests`, -1 where those of its face apply.
// `reaches`: pairs (distance, bits) of random candidates, within distance / 2^bits px.
__kernel void atlas_choose(const __global int *restrict chosen, const __global uint *restrict spots,
                           const __global int *restrict face, const __global int2 *restrict moves,
                           const __global short2 *restrict steps, const __global int *restrict table,
                           const __global int *restrict neighbors, const __global short2 *restrict rests,
                           const __global int *restrict index, const __global int2 *restrict source,
                           const __global int *restrict snap, const __global short *restrict color,
                           const __global int *restrict looks, const __global int *restrict basis,
                           const __global int2 *restrict reaches, __global int2 *restrict better, int count,
                           int atlas_width, int width, int height, int first, int tries, uint seed, uint step) {
  int j = get_global_id(0);
  if (j >= count) return;
  int i = chosen[j], row = table[i], x = corner_x(spots[i]), y = corner_y(spots[i]);
  // of each neighbor the pixel, and the step from the offset to its center
  const __global int *there = row < 0 ? index + AT(y, x, atlas_width) : neighbors + AT(row, 0, AROUND);
  const __global short2 *rest = row < 0 ? steps + AT(face[i], 0, AROUND) : rests + AT(row, 0, AROUND);
  moves += AT(face[i], 0, AROUND);
// The place whose color the copy of neighbor k shows here.
#define SHOWN(k) (source[there[row < 0 ? moves[k].y * (long)atlas_width + moves[k].x : (k)]] - convert_int2(rest[k]))
// The place with which the copy of neighbor k, at (u, v), continues here.
#define CONTINUED(k, u, v) (SHOWN(k) - (int2)(u, v) * ONE)
  int2 own = SHOWN(OWN);
  int pixel = taken(&own, snap, width, height), torn = first;
  for (int n = 0; n < CLOSE && !torn; n++) {
    int u = n % 3 - 1, v = n / 3 - 1;
    int2 place = CONTINUED(OWN + v * SIDE + u, u, v);
    torn = taken(&place, snap, width, height) != pixel;
  }
  if (!torn) {
    better[j] = own;
    return;
  }
  sum16 sum = 0;
  for (int k = 0; k < AROUND; k++) {
    const __global short *at = color + AT(pixel_at(SHOWN(k), width, height), 0, CHANNELS);
#pragma unroll 1
    for (int c = 0; c < CHANNELS; c++)
      sum += (sum_t)at[c] * __builtin_convertvector(
                                *(const __global looks16 *)(basis + AT(k * CHANNELS + c, 0, 16)), sum16);
  }
  looks16 wanted;
#pragma unroll
  for (int d = 0; d < 16; d++) wanted[d] = (int)rounded((long)sum[d], BASIS_BITS);
  long least = LONG_MAX;
#pragma unroll 1
  for (int n = 0; n < CLOSE; n++) {
    int u = n % 3 - 1, v = n / 3 - 1;
    int2 place = CONTINUED(OWN + v * SIDE + u, u, v);
    long cost = 5 * distance16(looks, taken(&place, snap, width, height), wanted);
    if (cost < least) least = cost, own = place;
  }
#pragma unroll 1
  for (int n = 0; n < tries; n++) {
    uint chance = hash_at(seed, step + (uint)n, y, x);
    int2 place = source[i];
    long dx = (long)(chance & 0xffffu) - 32768, dy = (long)(chance >> 16) - 32768;
    place.x += (int)rounded(dx * reaches[n].x, 15 + reaches[n].y) * ONE;
    place.y += (int)rounded(dy * reaches[n].x, 15 + reaches[n].y) * ONE;
    long cost = 8 * distance16(looks, taken(&place, snap, width, height), wanted);   // 1.6 times that of a neighbor
    if (cost < least) least = cost, own = place;
  }
  better[j] = own;
}

// The chosen pixels get their new sources.
__kernel void atlas_adopt(const __global int *restrict chosen, const __global int2 *restrict better,
                          __global int2 *restrict source, int count) {
  int j = get_global_id(0);
  if (j < count) source[chosen[j]] = better[j];
}
