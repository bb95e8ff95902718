// Candidate sets of stack texels: HRRG08 eq. 2, searched as PatchMatch does (BSFG09): good matches of neighbours are
// carried over, and places around the best one are tried at random. Belongs to synthesis/candidates.py.
#include "hash.h"
#include "projected.h"

// What is searched: targets on the levels of `admissible`, pairs of (level, log2 of how much finer it is), never on
// transparent pixels, and outside the disc around `excluded` (by its texel; ~0: none) of squared radius `disc`.
typedef struct { uint texel, cost; } found;

inline int around(int d, int side) {
  int half_way = 1 << (side - 1);
  d &= (1 << side) - 1;
  return d > half_way ? (1 << side) - d : d;
}

inline found better(found best, uint texel, projected own, const __global short *projections,
                    const __global uchar *usable, uint excluded, int disc, int side) {
  if (texel == best.texel || !usable[texel]) return best;
  if (excluded != ~0u && TEXEL_LEVEL(texel, side) == TEXEL_LEVEL(excluded, side)) {
    int dx = around(TEXEL_X(texel, side) - TEXEL_X(excluded, side), side);
    int dy = around(TEXEL_Y(texel, side) - TEXEL_Y(excluded, side), side);
    if (dx * dx + dy * dy < disc) return best;
  }
  uint cost = projected_distance(own, projections + DIMS * (size_t)texel);
  if (cost >= best.cost) return best;
  found it = {texel, cost};
  return it;
}

// A random target for every texel of `level`; where nothing can be had at 16 tries, cost stays at its most.
__kernel void candidates_start(const __global short *restrict projections, const __global uchar *restrict usable,
                               const __global int *restrict admissible, int count,
                               const __global uint *restrict excluded, int disc,
                               __global uint *restrict texel, __global uint *restrict cost, int level, int side, uint seed) {
  int x = get_global_id(0), y = get_global_id(1);
  if (x >= 1 << side || y >= 1 << side) return;
  int p = (y << side) + x;
  projected own = projected_at(projections + DIMS * (((size_t)level << (2 * side)) + p));
  found best = {texel_at(admissible[0], y, x, side), ~0u};
  uint bits = hash_at(seed, 0x5EED0000u + (uint)level, y, x);
  for (int k = 0; k < 16; k++) {
    bits = hash_pcg(bits + (uint)k);
    int into = admissible[2 * hash_below(bits, count)];
    bits = hash_pcg(bits);
    best = better(best, texel_at(into, (int)(bits >> 16), (int)bits, side), own, projections, usable,
                  excluded[p], disc, side);
  }
  texel[p] = best.texel;
  cost[p] = best.cost;
}

// One Jacobi pass: the targets of the four neighbours `jump` texels away, shifted back. One texel of this level is as
// wide as 2^r of a level that is r finer.
__kernel void candidates_propagate(const __global short *restrict projections, const __global uchar *restrict usable,
                                   const __global int *restrict admissible, int count,
                                   const __global uint *restrict excluded, int disc,
                                   const __global uint *restrict texel, const __global uint *restrict cost,
                                   __global uint *restrict texel_out, __global uint *restrict cost_out,
                                   int level, int side, int jump) {
  int x = get_global_id(0), y = get_global_id(1), inside = (1 << side) - 1;
  if (x > inside || y > inside) return;
  int p = (y << side) + x;
  projected own = projected_at(projections + DIMS * (((size_t)level << (2 * side)) + p));
  found best = {texel[p], cost[p]};
  for (int k = 0; k < 4; k++) {
    int dx = k == 0 ? -jump : k == 1 ? jump : 0, dy = k == 2 ? -jump : k == 3 ? jump : 0;
    uint other = texel[(((y + dy) & inside) << side) + ((x + dx) & inside)];
    int into = TEXEL_LEVEL(other, side), finer = 0;
    for (int n = 0; n < count; n++) finer = admissible[2 * n] == into ? admissible[2 * n + 1] : finer;
    uint back = texel_at(into, TEXEL_Y(other, side) - dy * (1 << finer), TEXEL_X(other, side) - dx * (1 << finer), side);
    best = better(best, back, own, projections, usable, excluded[p], disc, side);
  }
  texel_out[p] = best.texel;
  cost_out[p] = best.cost;
}

// Random search: around the best so far in windows that shrink by half, and anywhere on a random level.
__kernel void candidates_search(const __global short *restrict projections, const __global uchar *restrict usable,
                                const __global int *restrict admissible, int count,
                                const __global uint *restrict excluded, int disc,
                                __global uint *restrict texel, __global uint *restrict cost,
                                int level, int side, uint seed, uint step) {
  int x = get_global_id(0), y = get_global_id(1);
  if (x >= 1 << side || y >= 1 << side) return;
  int p = (y << side) + x;
  projected own = projected_at(projections + DIMS * (((size_t)level << (2 * side)) + p));
  found best = {texel[p], cost[p]};
  uint bits = hash_at(seed, ((uint)level << 16) + step, y, x);
  for (int k = 0; k < 2; k++) {
    bits = hash_pcg(bits + (uint)k);
    int into = admissible[2 * hash_below(bits, count)];
    bits = hash_pcg(bits);
    best = better(best, texel_at(into, (int)(bits >> 16), (int)bits, side), own, projections, usable,
                  excluded[p], disc, side);
  }
  for (int reach = 1 << (side - 2); reach >= 1; reach >>= 1) {
    bits = hash_pcg(bits + (uint)reach);
    int dx = hash_below(bits, 2 * reach + 1) - reach;
    bits = hash_pcg(bits);
    int dy = hash_below(bits, 2 * reach + 1) - reach;
    uint near = texel_at(TEXEL_LEVEL(best.texel, side), TEXEL_Y(best.texel, side) + dy, TEXEL_X(best.texel, side) + dx, side);
    best = better(best, near, own, projections, usable, excluded[p], disc, side);
  }
  texel[p] = best.texel;
  cost[p] = best.cost;
}
