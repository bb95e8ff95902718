// Candidate sets of stack texels: HRRG08 eq. 2, searched as in PatchMatch (BSFG09): good matches are propagated from
// neighbors, and random places around the best one are tried. Belongs to multiscale/candidate_sets.py.
//
// On a CPU an item processes RUN texels of a row: it first prefetches the candidates of all, then compares them.
#include "hash.h"
#include "projected.h"

// Search domain: targets on the levels of `admissible`, pairs of (level, log2 of its resolution relative to this one),
// never on transparent pixels, and outside the disc around texel `excluded` (~0: none) of squared radius `disc`.
typedef struct { uint texel, cost; } found;

static inline int around(int d, int side) {
  int half_way = 1 << (side - 1);
  d &= (1 << side) - 1;
  return d > half_way ? (1 << side) - d : d;
}

static inline int near_excluded(uint texel, uint excluded, int disc, int side) {
  if (excluded == ~0u || TEXEL_LEVEL(texel, side) != TEXEL_LEVEL(excluded, side)) return 0;
  int dx = around(TEXEL_X(texel, side) - TEXEL_X(excluded, side), side);
  int dy = around(TEXEL_Y(texel, side) - TEXEL_Y(excluded, side), side);
  return dx * dx + dy * dy < disc;
}

// Each of RUN texels takes its candidate if that is better; `own` holds their neighborhoods, `excluded` their exclusions.
static inline void try_all(found *best, const uint *tried, const __global short *own, const __global short *projections,
                    const __global uchar *usable, const __global uint *excluded, int disc, int side) {
  for (int m = 0; m < RUN; m++) PREFETCH(projections + DIMS * (size_t)tried[m]);
  for (int m = 0; m < RUN; m++) {
    if (tried[m] == best[m].texel || !usable[tried[m]] || near_excluded(tried[m], excluded[m], disc, side)) continue;
    uint cost = projected_distance(projected_at(own + DIMS * m), projections + DIMS * (size_t)tried[m]);
    if (cost < best[m].cost) {
      best[m].texel = tried[m];
      best[m].cost = cost;
    }
  }
}

// A random texel of a random admissible level.
static inline uint anywhere(uint *bits, const __global int *admissible, int count, int side) {
  int into = admissible[2 * hash_below(*bits, count)];
  *bits = hash_pcg(*bits);
  return texel_at(into, (int)(*bits >> 16), (int)*bits, side);
}

// A random target for every texel of `level`; if 16 tries fail, the cost stays at its maximum.
__kernel void candidates_start(const __global short *restrict projections, const __global uchar *restrict usable,
                               const __global int *restrict admissible, int count,
                               const __global uint *restrict excluded, int disc,
                               __global uint *restrict texel, __global uint *restrict cost, int level, int side, uint seed) {
  int x = RUN * get_global_id(0), y = get_global_id(1);
  if (x >= 1 << side || y >= 1 << side) return;
  int p = (y << side) + x;
  const __global short *own = projections + DIMS * (((size_t)level << (2 * side)) + p);
  found best[RUN];
  uint bits[RUN], tried[RUN];
  for (int m = 0; m < RUN; m++) {
    best[m].texel = texel_at(admissible[0], y, x + m, side);
    best[m].cost = ~0u;
    bits[m] = hash_at(seed, 0x5EED0000u + (uint)level, y, x + m);
  }
  for (int k = 0; k < 16; k++) {
    for (int m = 0; m < RUN; m++) {
      bits[m] = hash_pcg(bits[m] + (uint)k);
      tried[m] = anywhere(bits + m, admissible, count, side);
    }
    try_all(best, tried, own, projections, usable, excluded + p, disc, side);
  }
  for (int m = 0; m < RUN; m++) {
    texel[p + m] = best[m].texel;
    cost[p + m] = best[m].cost;
  }
}

// One Jacobi pass: the targets of the four neighbors `jump` texels away, shifted back. A texel of this level is as
// wide as 2^r texels of a level that is r levels finer.
__kernel void candidates_propagate(const __global short *restrict projections, const __global uchar *restrict usable,
                                   const __global int *restrict admissible, int count,
                                   const __global uint *restrict excluded, int disc,
                                   const __global uint *restrict texel, const __global uint *restrict cost,
                                   __global uint *restrict texel_out, __global uint *restrict cost_out,
                                   int level, int side, int jump) {
  int x = RUN * get_global_id(0), y = get_global_id(1), inside = (1 << side) - 1;
  if (x > inside || y > inside) return;
  int p = (y << side) + x;
  const __global short *own = projections + DIMS * (((size_t)level << (2 * side)) + p);
  found best[RUN];
  uint tried[RUN];
  for (int m = 0; m < RUN; m++) {
    best[m].texel = texel[p + m];
    best[m].cost = cost[p + m];
  }
  for (int k = 0; k < 4; k++) {
    int dx = k == 0 ? -jump : k == 1 ? jump : 0, dy = k == 2 ? -jump : k == 3 ? jump : 0;
    for (int m = 0; m < RUN; m++) {
      uint other = texel[(((y + dy) & inside) << side) + ((x + m + dx) & inside)];
      int into = TEXEL_LEVEL(other, side), finer = 0;
      for (int n = 0; n < count; n++) finer = admissible[2 * n] == into ? admissible[2 * n + 1] : finer;
      tried[m] = texel_at(into, TEXEL_Y(other, side) - dy * (1 << finer), TEXEL_X(other, side) - dx * (1 << finer), side);
    }
    try_all(best, tried, own, projections, usable, excluded + p, disc, side);
  }
  for (int m = 0; m < RUN; m++) {
    texel_out[p + m] = best[m].texel;
    cost_out[p + m] = best[m].cost;
  }
}

// Random search: anywhere on a random level, and around the best so far in windows that shrink by half.
__kernel void candidates_search(const __global short *restrict projections, const __global uchar *restrict usable,
                                const __global int *restrict admissible, int count,
                                const __global uint *restrict excluded, int disc,
                                __global uint *restrict texel, __global uint *restrict cost,
                                int level, int side, uint seed, uint step) {
  int x = RUN * get_global_id(0), y = get_global_id(1);
  if (x >= 1 << side || y >= 1 << side) return;
  int p = (y << side) + x;
  const __global short *own = projections + DIMS * (((size_t)level << (2 * side)) + p);
  found best[RUN];
  uint bits[RUN], tried[RUN];
  for (int m = 0; m < RUN; m++) {
    best[m].texel = texel[p + m];
    best[m].cost = cost[p + m];
    bits[m] = hash_at(seed, ((uint)level << 16) + step, y, x + m);
  }
  for (int k = 0; k < 2; k++) {
    for (int m = 0; m < RUN; m++) {
      bits[m] = hash_pcg(bits[m] + (uint)k);
      tried[m] = anywhere(bits + m, admissible, count, side);
    }
    try_all(best, tried, own, projections, usable, excluded + p, disc, side);
  }
  for (int reach = 1 << (side - 2); reach >= 1; reach >>= 1) {
    for (int m = 0; m < RUN; m++) {
      bits[m] = hash_pcg(bits[m] + (uint)reach);
      int dx = hash_below(bits[m], 2 * reach + 1) - reach;
      bits[m] = hash_pcg(bits[m]);
      int dy = hash_below(bits[m], 2 * reach + 1) - reach;
      uint at = best[m].texel;
      tried[m] = texel_at(TEXEL_LEVEL(at, side), TEXEL_Y(at, side) + dy, TEXEL_X(at, side) + dx, side);
    }
    try_all(best, tried, own, projections, usable, excluded + p, disc, side);
  }
  for (int m = 0; m < RUN; m++) {
    texel[p + m] = best[m].texel;
    cost[p + m] = best[m].cost;
  }
}
