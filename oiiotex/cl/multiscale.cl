// Multiscale synthesis, HRRG08 section 4 and 5: pixels are texels of stack levels (projected.h says how they are
// named) with an accumulated transfer function R, an offset in steps of the color grid. Belongs to
// multiscale/synthesizer.py, which determines the pixels of a window that each pass may read.
#include "hash.h"
#include "projected.h"
#include "offsets.h"

#define BITS 12           // fraction bits of the basis
#define SIDE_TAPS 5       // side of a neighborhood
#define NEAR 9            // pixels whose candidates are tried
#define RECORD (2 * DIMS) // per texel: the neighborhoods of its two candidates, a cache line
// whether a pixel of a window is in the root's own cell
#define WITHIN_OWN(x, y) ((x) >= own_left && (y) >= own_top && (x) < own_right && (y) < own_bottom)
#define MOST_OFFSET 8191  // steps; sums of products stay within 31 bits
#if RUN > 1
#define UNROLL _Pragma("unroll")
#else
#define UNROLL _Pragma("unroll 1")   // unrolled, a GPU's registers overflow: 188 of gfx1030 instead of 66
#endif

static inline short4 offset_sum(int4 r) {
  r = r > MOST_OFFSET ? (int4)(MOST_OFFSET) : r;
  r = r < -MOST_OFFSET ? (int4)(-MOST_OFFSET) : r;
  return convert_short4(r);
}

// 24 random bits of the absolute place, level and seed. Places are 64-bit, and wrap on a torus.
static inline uint place_hash(long x, long y, uint level, uint seed) {
  uint bits = hash_pcg((uint)(x >> 32) + hash_pcg(level + hash_pcg(seed)));
  return hash_pcg((uint)x + hash_pcg((uint)y + hash_pcg((uint)(y >> 32) + bits)));
}

// A place past the border of an exemplar that does not tile is mirrored, as its stack is.
static inline int mirrored(int at, int side) {
  int within = at & ((2 << side) - 1), last = (1 << side) - 1;
  return within > last ? 2 * last + 1 - within : within;
}
static inline uint texel_within(int level, int y, int x, int side, int tiles) {
  return tiles ? texel_at(level, y, x, side) : texel_at(level, mirrored(y, side), mirrored(x, side), side);
}

// Upsampling (section 4.2), jitter (section 4.3) and inheritance of R (section 5): every pixel of a level from its
// parent. (left, top) is the origin of the window, (from_x, from_y) the parent of its first pixel in the parents'
// window. rho is in 1/256; `tiles` says for every level whether its exemplar is a torus. Departures: h_k is the
// child's spacing; past the end of a stack the texel is repeated; exemplars that do not tile are mirrored; R is
// keep/256 of the inherited one; pixels
// of the root's own cell have neither jitter nor R.
__kernel void multiscale_upsample(const __global uint *restrict parent, const __global short4 *restrict parent_r,
                                  __global uint *restrict texel, __global short4 *restrict r,
                                  __global short4 *restrict color, const __global short4 *restrict stack,
                                  const __global int *restrict finer, const __global int *restrict spacing,
                                  const __global int *restrict tiles, int side,
                                  int parent_width, int from_x, int from_y, int width, int height, long left, long top,
                                  long around_x, long around_y, uint level, uint seed, int rho, int keep,
                                  int own_left, int own_top, int own_right, int own_bottom) {
  int i = get_global_id(0), j = get_global_id(1);
  if (i >= width || j >= height) return;
  int odd_x = (int)((left + i) & 1), odd_y = (int)((top + j) & 1);
  int px = from_x + ((i + (int)(left & 1)) >> 1), py = from_y + ((j + (int)(top & 1)) >> 1);
  size_t p = AT(py, px, parent_width), q = AT(j, i, width);
  uint old = parent[p];
  int before = TEXEL_LEVEL(old, side), now = finer[before], h = spacing[now];
  int y = TEXEL_Y(old, side), x = TEXEL_X(old, side);
  if (now != before) {
    x += (h * (2 * odd_x - 1)) >> 1;   // rounded down, as in section 4.2
    y += (h * (2 * odd_y - 1)) >> 1;
  }
  long at_x = left + i, at_y = top + j;
  if (around_x > 0) at_x = ((at_x % around_x) + around_x) % around_x;
  if (around_y > 0) at_y = ((at_y % around_y) + around_y) % around_y;
  if (rho > 0 && !WITHIN_OWN(i, j)) {
    uint bits = place_hash(at_x, at_y, level, seed);
    // J = floor(h H rho + 1/2), H in [-1, 1) from 16 bits
    x += (int)(((long)h * rho * ((int)(bits >> 16) - 32768) + (1 << 22)) >> 23);
    y += (int)(((long)h * rho * ((int)(bits & 0xFFFFu) - 32768) + (1 << 22)) >> 23);
  }
  uint made = texel_within(now, y, x, side, tiles[now]);
  long nx = 2 * odd_x - 1, ny = (2 * odd_y - 1) * (long)parent_width;   // the four nearest parents
  int4 inherited = 9 * convert_int4(parent_r[p]) + 3 * convert_int4(parent_r[p + nx]) +
                   3 * convert_int4(parent_r[p + ny]) + convert_int4(parent_r[p + nx + ny]);
  short4 offset = WITHIN_OWN(i, j) ? (short4)(0) : offset_sum((inherited * keep + 2048) >> 12);
  texel[q] = made;
  r[q] = offset;
  color[q] = stack[made] + offset;
}

// --- correction (section 4.4) ---

#if LANES > 1
typedef struct { lane_i8 low, high; } sums;
static inline void clear(sums *s) { s->low = s->high = (lane_i8)(0); }
// Products of a pair of 16-bit numbers with eight pairs of the basis, added per pair. Uses an intrinsic if available:
// with one pair in all lanes compilers do not recognize the generic code below.
static inline lane_i8 pair_products(int pair, const __global short *basis) {
  lane_s16 v = __builtin_astype((lane_i8)(pair), lane_s16), b = *(const __global lane_s16 *)basis;
#ifdef __AVX2__
  return __builtin_ia32_pmaddwd256(v, b);
#else
  lane_i8 even = __builtin_convertvector(v.even, lane_i8) * __builtin_convertvector(b.even, lane_i8);
  lane_i8 odd = __builtin_convertvector(v.odd, lane_i8) * __builtin_convertvector(b.odd, lane_i8);
  return even + odd;
#endif
}
static inline void add_pair(sums *s, int pair, const __global short *basis) {
  s->low += pair_products(pair, basis);
  s->high += pair_products(pair, basis + DIMS);
}
static inline lane_i8 scaled8(lane_i8 v) {
  v = (v + (1 << (BITS - 1))) >> BITS;
  v = v > MOST_PROJECTED ? (lane_i8)(MOST_PROJECTED) : v;
  return v < -MOST_PROJECTED ? (lane_i8)(-MOST_PROJECTED) : v;
}
static inline void scale(const sums *s, projected *found) {
  lane_s16 v;
  v.lo = __builtin_convertvector(scaled8(s->low), __typeof__(v.lo));
  v.hi = __builtin_convertvector(scaled8(s->high), __typeof__(v.hi));
  *found = v;
}
#else
typedef struct { int at[DIMS]; } sums;
static inline void clear(sums *s) {   // by pointer: Oclgrind cannot run the code that results from inlining returned structures
  for (int d = 0; d < DIMS; d++) s->at[d] = 0;
}
static inline void add_pair(sums *s, int pair, const __global short *basis) {
  int a = (short)(pair & 0xFFFF), b = pair >> 16;
  const __global int *pairs = (const __global int *)basis;   // whole words, which all items of a wave share
  for (int d = 0; d < DIMS; d++) s->at[d] += a * (short)(pairs[d] & 0xFFFF) + b * (pairs[d] >> 16);
}
static inline void scale(const sums *s, projected *found) {
  short *to = (short *)found;
  for (int d = 0; d < DIMS; d++) {
    int v = (s->at[d] + (1 << (BITS - 1))) >> BITS;
    to[d] = (short)(v > MOST_PROJECTED ? MOST_PROJECTED : v < -MOST_PROJECTED ? -MOST_PROJECTED : v);
  }
}
#endif

// The neighborhood of pixel p minus its own R, projected (section 6): R_p^-1 (R_(p+d) (*S[p + d])) of eq. 5. R_p applies
// to the whole neighborhood, so the candidates' precomputed neighborhoods are used unchanged. A pixel is two pairs,
// (L, a) and (b, 0); `basis` holds rows for the pairs of each tap, and for their sums, the weight of R_p.
static inline void project_around(projected *found, const __global int *color, size_t p, int width, short4 own,
                           const __global short *basis) {
  sums total;
  clear(&total);
  for (int dy = -SIDE_TAPS / 2; dy <= SIDE_TAPS / 2; dy++) {
    const __global int *pairs = color + 2 * ((long)p + dy * (long)width - SIDE_TAPS / 2);
    UNROLL for (int n = 0; n < 2 * SIDE_TAPS; n++, basis += 2 * DIMS) add_pair(&total, pairs[n], basis);
  }
  int2 less = as_int2((short4)(0) - own);
  add_pair(&total, less.x, basis);
  add_pair(&total, less.y, basis + 2 * DIMS);
  scale(&total, found);
}

// The n-th texel whose candidates pixel p may take: those of its 3 x 3 neighbors, shifted to its place, its own first.
static inline uint expected(int n, const __global uint *texel, size_t p, int width, const __global int *spacing, int side) {
  int turn = n + 4 < NEAR ? n + 4 : n - 5, dy = turn / 3 - 1, dx = turn % 3 - 1;
  uint other = texel[(long)p + dy * (long)width + dx];
  int level = TEXEL_LEVEL(other, side), h = spacing[level];
  return texel_at(level, TEXEL_Y(other, side) - dy * h, TEXEL_X(other, side) - dx * h, side);
}

// The best candidate (eq. 3) as 2 texel + its number; ties to candidate 1 of any texel before candidate 2, then to the
// first texel. On a GPU the nine texels are found here one by one, because keeping them would take registers.
static inline uint best_candidate(const uint *near, const __global uint *texel, size_t p, int width,
                                  const __global int *spacing, int side, projected wanted,
                                  const __global short *records, int penalty) {
  uint best = ~0u, second = ~0u, best_at = 0, second_at = 0;
  UNROLL for (int n = 0; n < NEAR; n++) {
    uint at = RUN > 1 ? near[n] : expected(n, texel, p, width, spacing, side);
    const __global short *record = records + RECORD * (size_t)at;
    uint cost = projected_distance(wanted, record), other = projected_distance(wanted, record + DIMS);
    best_at = cost < best ? at : best_at;
    best = cost < best ? cost : best;
    second_at = other < second ? at : second_at;
    second = other < second ? other : second;
  }
  second += (second >> 4) * (uint)penalty;
  return second < best ? 2 * second_at + 1 : 2 * best_at;
}

// One subpass: pixels (first_x + 2 i, first_y + 2 j) take the candidate of their 3 x 3 neighbors (eq. 3) that fits
// best by eq. 5. They read texels of neighbors with other parities, and colors that change only in multiscale_color,
// so their order does not matter. An item processes RUN pixels of a row.
// Departures: a neighbor's texel is shifted before its candidates are looked up, so that they need no separate
// correction; costs of second candidates are multiplied by (16 + penalty) / 16; pixels of
// the root's own cell keep their texel.
__kernel void multiscale_correct(__global uint *restrict texel, __global short4 *restrict r,
                                 const __global int *restrict color, const __global uint *restrict links,
                                 const __global short *restrict records, const __global short4 *restrict offsets,
                                 const __global short *restrict basis, const __global int *restrict spacing, int side,
                                 int width, int first_x, int first_y, int count_x, int count_y, int penalty,
                                 int own_left, int own_top, int own_right, int own_bottom) {
  int i = RUN * get_global_id(0), j = get_global_id(1);
  if (i >= count_x || j >= count_y) return;
  size_t first = AT(first_y + 2 * j, first_x + 2 * i, width);
  int count = count_x - i < RUN ? count_x - i : RUN;
  uint near[NEAR * RUN], chosen[RUN];
  for (int m = 0; m < count; m++) {
    UNROLL for (int n = 0; RUN > 1 && n < NEAR; n++) {
      near[NEAR * m + n] = expected(n, texel, first + 2 * m, width, spacing, side);
      PREFETCH(records + RECORD * (size_t)near[NEAR * m + n]);
    }
  }
  for (int m = 0; m < count; m++) {
    projected wanted;
    project_around(&wanted, color, first + 2 * m, width, r[first + 2 * m], basis);
    chosen[m] = best_candidate(near + NEAR * m, texel, first + 2 * m, width, spacing, side, wanted, records, penalty);
  }
  for (int m = 0; m < count; m++) {
    if (WITHIN_OWN(first_x + 2 * (i + m), first_y + 2 * j)) continue;
    size_t p = first + 2 * m;
    texel[p] = links[chosen[m]];
    r[p] = offset_sum(convert_int4(r[p]) + convert_int4(offsets[chosen[m]]));   // composed with the candidate's r
  }
}

// Updates the colors of a subpass: R(*S).
__kernel void multiscale_color(const __global uint *restrict texel, const __global short4 *restrict r,
                                const __global short4 *restrict stack, __global short4 *restrict color,
                                int width, int first_x, int first_y, int count_x, int count_y) {
  int i = get_global_id(0), j = get_global_id(1);
  if (i >= count_x || j >= count_y) return;
  size_t p = AT(first_y + 2 * j, first_x + 2 * i, width);
  color[p] = stack[texel[p]] + r[p];
}
