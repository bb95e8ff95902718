// Image quilting (Efros & Freeman 2001) as a plan: for every cell of a grid of patches, which exemplar patch lies
// there and how it is cut against the cells before it. LSA16 section 6.1 chooses candidates by their content.
//
// A cell (i, j) has its top-left pixel at (xs[j], ys[i]) of the output. Its patch begins at offset[cell] of the
// exemplar (y << 16 | x); pixel (lx, ly) of it shows where lx >= vertical[ly] and ly >= horizontal[lx]. What does not
// show there is the cell to the left, where its own horizontal cut lets it, else the row of cells above. So the plan
// gives the source of any output pixel, and no pixels need to be kept while it is made.
//
// Images are rows of interleaved 16-bit (L, a, b) on an integer grid. All costs are integers.
#include "lanes.h"
#include "hash.h"

#define NONE 0xffffffffu
#define NO_COST LONG_MAX
#define FULL_TRIES 4    // fresh draws for a candidate whose region is used up
#define COARSE 4        // the first look at all candidates takes images reduced by this
#define SHORTLIST 8     // candidates that are looked at in full
#define BINS 256        // labels of finer levels are counted modulo this
#define LABEL_STEP 4    // every 4th pixel's labels are held, in both directions
#define GUIDE 4         // samples of the guide along a side

inline uint corner(int y, int x) { return (uint)y << 16 | (uint)x; }
inline int corner_y(uint c) { return (int)(c >> 16); }
inline int corner_x(uint c) { return (int)(c & 0xffffu); }

// What does not change during a run; see synthesis/quilting.py, _FACTS.
typedef struct {
  int patch, overlap, width, height, columns, rows, wrap_x, wrap_y;
  int e_width, e_columns, e_rows, block, blocks_across, candidates, levels, stride, flush;
  uint seed;
  int guided;
} facts;

typedef struct {
  __constant facts *f;
  __global const int *xs, *ys;
  __global const uint *offset;
  __global const uchar *vertical, *horizontal;
} plan;

inline int left_of(__constant facts *f, int j) { return j > 0 ? j - 1 : f->wrap_x ? f->columns - 1 : -1; }
inline int right_of(__constant facts *f, int j) { return j + 1 < f->columns ? j + 1 : f->wrap_x ? 0 : -1; }
inline int above(__constant facts *f, int i) { return i > 0 ? i - 1 : f->wrap_y ? f->rows - 1 : -1; }
inline int below(__constant facts *f, int i) { return i + 1 < f->rows ? i + 1 : f->wrap_y ? 0 : -1; }

// How far column b lies to the right of its left neighbour a; rows likewise.
inline int step_x(const plan *p, int a, int b) { return p->xs[b] - p->xs[a] + (b <= a ? p->f->width : 0); }
inline int step_y(const plan *p, int a, int b) { return p->ys[b] - p->ys[a] + (b <= a ? p->f->height : 0); }

inline uint placed(const plan *p, int i, int j) { return i < 0 || j < 0 ? NONE : p->offset[i * p->f->columns + j]; }

// The source of a pixel among the cells of row i alone: (lx, ly) counts from cell (i, j), and may lie in the next ones.
inline uint row_source(const plan *p, int i, int j, int lx, int ly) {
  for (;;) {
    int next = right_of(p->f, j);
    if (next < 0 || placed(p, i, next) == NONE) break;
    int step = step_x(p, j, next);
    if (lx < step) break;
    lx -= step;
    j = next;
  }
  if (lx < p->f->overlap && lx < p->vertical[(i * p->f->columns + j) * p->f->patch + ly]) {
    int left = left_of(p->f, j);
    return placed(p, i, left) + corner(ly, lx + step_x(p, left, j));
  }
  return placed(p, i, j) + corner(ly, lx);
}

// The source of pixel (lx, ly) of cell (i, j) if the cell itself were not there; only asked for in its overlaps.
inline uint old_source(const plan *p, int i, int j, int lx, int ly) {
  int left = left_of(p->f, j);
  if (lx < p->f->overlap && placed(p, i, left) != NONE) {
    int x = lx + step_x(p, left, j), cell = i * p->f->columns + left;
    if (ly >= p->horizontal[cell * p->f->patch + x]) return p->offset[cell] + corner(ly, x);
  }
  int up = above(p->f, i);
  return row_source(p, up, j, lx, ly + step_y(p, up, i));
}

// --- the plan as pixels ---

// column[x], row[y]: the last cell that begins at or before the pixel. Gives y * e_width + x of the source.
__kernel void quilting_render(__constant facts *f, __global const int *xs, __global const int *ys,
                              __global const uint *offset, __global const uchar *vertical,
                              __global const uchar *horizontal, __global const int *column, __global const int *row,
                              __global uint *restrict source, int left, int top, int width, int height) {
  int x = get_global_id(0), y = get_global_id(1);
  if (x >= width || y >= height) return;
  plan p = {f, xs, ys, offset, vertical, horizontal};
  int j = column[x], i = row[y];
  int lx = left + x - xs[j], ly = top + y - ys[i], cell = i * f->columns + j;
  ly -= ly >= f->patch ? f->height : 0;   // where the torus closes, the first row begins above the last rows' end
  uint at;
  if ((lx >= f->overlap || lx >= vertical[cell * f->patch + ly]) &&
      (ly >= f->overlap || ly >= horizontal[cell * f->patch + lx]))
    at = offset[cell] + corner(ly, lx);
  else
    at = old_source(&p, i, j, lx, ly);
  source[y * width + x] = (uint)(corner_y(at) * f->e_width + corner_x(at));
}

// --- what lies around a cell ---

// Sides on which a cell meets others that are placed. To the right and below there are such where the torus closes and
// where single cells are made anew.
#define LEFT 1
#define TOP 2
#define RIGHT 4
#define BOTTOM 8
inline int sides_of(const plan *p, int i, int j) {
  return (placed(p, i, left_of(p->f, j)) != NONE ? LEFT : 0) | (placed(p, above(p->f, i), j) != NONE ? TOP : 0) |
         (placed(p, i, right_of(p->f, j)) != NONE ? RIGHT : 0) | (placed(p, below(p->f, i), j) != NONE ? BOTTOM : 0);
}

// Where the right and lower overlaps begin inside the patch.
inline int right_at(const plan *p, int j) { return step_x(p, j, right_of(p->f, j)); }
inline int bottom_at(const plan *p, int i) { return step_y(p, i, below(p->f, i)); }

// The source of what lies under pixel (lx, ly) of cell (i, j), NONE outside the overlaps.
inline uint around(const plan *p, int sides, int i, int j, int lx, int ly) {
  int overlap = p->f->overlap;
  if (((sides & LEFT) && lx < overlap) || ((sides & TOP) && ly < overlap)) return old_source(p, i, j, lx, ly);
  if (sides & RIGHT) {
    int x = lx - right_at(p, j);
    if (x >= 0 && x < overlap) return placed(p, i, right_of(p->f, j)) + corner(ly, x);
  }
  if (sides & BOTTOM) {
    int y = ly - bottom_at(p, i);
    if (y >= 0 && y < overlap) return placed(p, below(p->f, i), j) + corner(y, lx);
  }
  return NONE;
}

// The overlaps of a cell as an image of patch x patch pixels; the rest of it is not touched.
__kernel void quilting_target(__constant facts *f, __global const int *xs, __global const int *ys,
                              __global const uint *offset, __global const uchar *vertical,
                              __global const uchar *horizontal, __global const uint *order, int first,
                              __global const short *restrict exemplar, __global short *restrict target, int cells) {
  int ly = get_global_id(0), n = get_global_id(1);
  if (ly >= f->patch || n >= cells) return;
  plan p = {f, xs, ys, offset, vertical, horizontal};
  uint cell = order[first + n];
  int i = cell / f->columns, j = cell % f->columns, sides = sides_of(&p, i, j);
  __global short *to = target + 3 * (n * f->patch + ly) * f->patch;
  for (int lx = 0; lx < f->patch; lx++, to += 3) {
    uint at = around(&p, sides, i, j, lx, ly);
    if (at == NONE) continue;
    const __global short *from = exemplar + 3 * (corner_y(at) * f->e_width + corner_x(at));
    for (int c = 0; c < 3; c++) to[c] = from[c];
  }
}

// The overlaps reduced by COARSE; halves go up, as in quilting.py, reduced.
__kernel void quilting_reduce(__constant facts *f, __global const short *restrict target,
                              __global short *restrict coarse, int cells) {
  int v = get_global_id(0), n = get_global_id(1), side = f->patch / COARSE;
  if (v >= side || n >= cells) return;
  const __global short *from = target + 3 * (n * f->patch + COARSE * v) * f->patch;
  __global short *to = coarse + 3 * (n * side + v) * side;
  for (int u = 0; u < side; u++)
    for (int c = 0; c < 3; c++) {
      int sum = 0;
      for (int y = 0; y < COARSE; y++)
        for (int x = 0; x < COARSE; x++) sum += from[3 * (y * f->patch + COARSE * u + x) + c];
      to[3 * u + c] = (short)((sum + 8) >> 4);
    }
}

// Where an exemplar pixel's labels are held.
inline int label_at(__constant facts *f, int y, int x) {
  return y / LABEL_STEP * ((f->e_width + LABEL_STEP - 1) / LABEL_STEP) + x / LABEL_STEP;
}

// Histograms of the finer levels' labels over the overlaps (LSA16 eq. 9), from samples `stride` px apart.
__kernel void quilting_histogram(__constant facts *f, __global const int *xs, __global const int *ys,
                                 __global const uint *offset, __global const uchar *vertical,
                                 __global const uchar *horizontal, __global const uint *order, int first,
                                 __global const uchar *restrict finer, __global short *restrict histogram, int cells) {
  int level = get_global_id(0), n = get_global_id(1);
  if (level >= f->levels || n >= cells) return;
  plan p = {f, xs, ys, offset, vertical, horizontal};
  uint cell = order[first + n];
  int i = cell / f->columns, j = cell % f->columns, sides = sides_of(&p, i, j);
  __global short *bins = histogram + (n * f->levels + level) * BINS;
  for (int b = 0; b < BINS; b++) bins[b] = 0;
  for (int ly = f->stride / 2; ly < f->patch; ly += f->stride)
    for (int lx = f->stride / 2; lx < f->patch; lx += f->stride) {
      uint at = around(&p, sides, i, j, lx, ly);
      if (at != NONE) bins[finer[label_at(f, corner_y(at), corner_x(at)) * f->levels + level]]++;
    }
}

// --- how well a candidate fits ---

// Sum of squared differences over a rectangle; after `flush` rows what has been added still fits 32 bits.
inline long strip_distance(const __global short *t, const __global short *e, int t_row, int e_row, int n, int rows,
                           int flush) {
  long total = 0;
  for (int begin = 0; begin < rows; begin += flush) {
    int end = begin + flush < rows ? begin + flush : rows, s1 = 0;
#if LANES > 1
    lane_i8 s16 = 0;
    lane_i4 s8 = 0;
#if LANES > 16
    lane_i16 s32 = 0;
#endif
#endif
    for (int r = begin; r < end; r++, t += t_row, e += e_row) {
      int k = 0;
#if LANES > 16
      for (; k + 32 <= n; k += 32)
        s32 += squares32(*(const __global lane_s32 *)(t + k) - *(const __global lane_s32 *)(e + k));
#endif
#if LANES > 1
      for (; k + 16 <= n; k += 16)
        s16 += squares16(*(const __global lane_s16 *)(t + k) - *(const __global lane_s16 *)(e + k));
      for (; k + 8 <= n; k += 8)
        s8 += squares8(*(const __global lane_s8 *)(t + k) - *(const __global lane_s8 *)(e + k));
#endif
      for (; k < n; k++) {
        int d = t[k] - e[k];
        s1 += d * d;
      }
    }
#if LANES > 1
    s1 += total4(s8) + total8(s16);
#if LANES > 16
    s1 += total16(s32);
#endif
#endif
    total += s1;
  }
  return total;
}

// Sum of squared differences over the overlaps; the lower one has `rows` rows from `bottom` on, the right one `columns`
// columns from `right` on.
inline long overlap_distance(int sides, const __global short *t, const __global short *e, int patch, int overlap,
                             int e_width, int bottom, int rows, int right, int columns, int flush) {
  int t_row = 3 * patch, e_row = 3 * e_width, from = sides & TOP ? overlap : 0, left = sides & LEFT ? overlap : 0;
  long sum = 0;
  if (sides & TOP) sum += strip_distance(t, e, t_row, e_row, 3 * patch, overlap, flush);
  if (sides & LEFT)
    sum += strip_distance(t + from * t_row, e + from * e_row, t_row, e_row, 3 * overlap, patch - from, flush);
  if (sides & BOTTOM)
    sum += strip_distance(t + bottom * t_row + 3 * left, e + bottom * e_row + 3 * left, t_row, e_row,
                          3 * (patch - left), rows, flush);
  if (sides & RIGHT) {   // above the lower strip, and below it where a small torus leaves something
    int to = sides & BOTTOM ? bottom : patch, rest = to + rows;
    t += 3 * right;
    e += 3 * right;
    sum += strip_distance(t + from * t_row, e + from * e_row, t_row, e_row, 3 * columns, to - from, flush);
    if (rest < patch)
      sum += strip_distance(t + rest * t_row, e + rest * e_row, t_row, e_row, 3 * columns, patch - rest, flush);
  }
  return sum;
}

// All that is needed to say what a candidate costs in a cell.
typedef struct {
  const plan *p;
  const __global short *target, *exemplar, *coarse_target, *coarse;
  const __global uchar *finer;
  const __global short *histogram;
  const __global ushort *guide, *labels;
  int sides, i, j;
  long finer_unit, guide_unit;
} place;

// What speaks against a candidate beside its colours: labels of finer levels that its overlaps have too many of
// (those it has too many are as many as it lacks), and samples whose label is not the guide's.
inline long label_cost(const place *at, int ey, int ex, int bottom, int right) {
  __constant facts *f = at->p->f;
  int patch = f->patch, overlap = f->overlap, apart = 0, wrong = 0;
  for (int level = 0; at->sides && level < f->levels; level++) {
    short bins[BINS];
    const __global short *old = at->histogram + level * BINS;
    for (int b = 0; b < BINS; b++) bins[b] = old[b];
    for (int ly = f->stride / 2; ly < patch; ly += f->stride) {
      int whole = ((at->sides & TOP) && ly < overlap) || (ly >= bottom && ly < bottom + overlap);
      for (int lx = f->stride / 2; lx < patch; lx += f->stride) {
        if (!whole && !((at->sides & LEFT) && lx < overlap) && !(lx >= right && lx < right + overlap)) {
          if (right == patch) break;   // there is nothing more in this row
          continue;
        }
        apart += bins[at->finer[label_at(f, ey + ly, ex + lx) * f->levels + level]]-- > 0 ? 0 : 1;
      }
    }
  }
  for (int v = 0; f->guided && v < GUIDE; v++)
    for (int u = 0; u < GUIDE; u++) {
      int y = (2 * v + 1) * patch / (2 * GUIDE), x = (2 * u + 1) * patch / (2 * GUIDE);
      ushort wanted = at->guide[v * GUIDE + u];
      wrong += wanted != 0 && wanted != at->labels[label_at(f, ey + y, ex + x)];
    }
  return at->finer_unit * apart + at->guide_unit * wrong;
}

inline long cost_at(const place *at, uint candidate) {
  __constant facts *f = at->p->f;
  int ey = corner_y(candidate), ex = corner_x(candidate);
  int bottom = at->sides & BOTTOM ? bottom_at(at->p, at->i) : f->patch;
  int right = at->sides & RIGHT ? right_at(at->p, at->j) : f->patch;
  return label_cost(at, ey, ex, bottom, right) +
         overlap_distance(at->sides, at->target, at->exemplar + 3 * (ey * f->e_width + ex), f->patch, f->overlap,
                          f->e_width, bottom, min(f->patch - bottom, f->overlap), right,
                          min(f->patch - right, f->overlap), f->flush);
}

// The same from images reduced by COARSE: most candidates are out of the question, and a first look at all of these
// stays within a cache.
inline long first_cost(const place *at, uint candidate) {
  __constant facts *f = at->p->f;
  int ey = corner_y(candidate), ex = corner_x(candidate);
  int bottom = at->sides & BOTTOM ? bottom_at(at->p, at->i) : f->patch;
  int right = at->sides & RIGHT ? right_at(at->p, at->j) : f->patch;
  int patch = f->patch / COARSE, width = f->e_width / COARSE;
  int y = (ey + COARSE / 2) / COARSE, x = (ex + COARSE / 2) / COARSE;
  int most_y = (f->e_rows + f->patch - 1) / COARSE - patch, most_x = width - patch;
  y = y < most_y ? y : most_y;
  x = x < most_x ? x : most_x;
  // of the lower and right overlaps only squares that lie in them as a whole
  int low = (bottom + COARSE - 1) / COARSE, low_end = min((bottom + f->overlap) / COARSE, patch);
  int far = (right + COARSE - 1) / COARSE, far_end = min((right + f->overlap) / COARSE, patch);
  low = min(low, patch);
  far = min(far, patch);
  return label_cost(at, ey, ex, bottom, right) +
         COARSE * COARSE * overlap_distance(at->sides, at->coarse_target, at->coarse + 3 * (y * width + x), patch,
                                            f->overlap / COARSE, width, low, max(low_end - low, 0), far,
                                            max(far_end - far, 0), f->flush);
}

// --- the content table ---

typedef struct {
  __constant facts *f;
  const __global uint *offsets;                            // by key, then by range
  const __global int *starts, *ranges, *range_blocks, *range_starts;
  const __global uint *key_map;
} content;

// The range (one block's offsets of one key) of an offset that has this key.
inline int range_of(const content *c, int key, uint at) {
  int block = corner_y(at) / c->f->block * c->f->blocks_across + corner_x(at) / c->f->block;
  int low = c->ranges[key], high = c->ranges[key + 1] - 1;
  while (low < high) {
    int middle = (low + high) / 2;
    if (c->range_blocks[middle] < block) low = middle + 1; else high = middle;
  }
  return low;
}

// Candidate k of a cell: all offsets of its key in an order that begins anywhere, or a sample where they are too many.
inline uint candidate_of(const content *c, int key, int i, int j, int k, const __global int *uses,
                         const __global int *cap) {
  int first = c->starts[key], count = c->starts[key + 1] - first;
  for (int draw = 0; draw < FULL_TRIES; draw++) {
    int pick;
    if (count <= c->f->candidates) {
      if (k >= count || draw > 0) return NONE;
      pick = k + hash_below(hash_at(c->f->seed, 0x917, i, j), count);
      pick -= pick >= count ? count : 0;
    } else {
      pick = hash_below(hash_at(c->f->seed, 0x10000u + FULL_TRIES * k + draw, i, j), count);
    }
    uint at = c->offsets[first + pick];
    if (uses[range_of(c, key, at)] < cap[key]) return at;
  }
  return NONE;
}

#define PLAN_ARGS __constant facts *f, __global const int *xs, __global const int *ys, __global const uint *offset, \
                  __global const uchar *vertical, __global const uchar *horizontal
#define PLACE_ARGS __global const uint *order, int first, int cells, __global const int *keys,                        \
                   __global const short *target, __global const short *exemplar,                                     \
                   __global const short *coarse_target, __global const short *coarse, __global const uchar *finer,   \
                   __global const short *histogram, __global const ushort *guide, __global const ushort *labels,     \
                   long finer_unit, long guide_unit
#define CONTENT_ARGS __global const uint *offsets, __global const int *starts, __global const int *ranges,            \
                     __global const int *range_blocks, __global const int *range_starts,                             \
                     __global const uint *key_map, __global const int *uses, __global const int *cap
#define BEGIN_PLACE                                                                                                  \
  plan p = {f, xs, ys, offset, vertical, horizontal};                                                                \
  uint cell = order[first + n];                                                                                      \
  int i = cell / f->columns, j = cell % f->columns, key = keys[cell];                                                \
  int coarse_side = f->patch / COARSE;                                                                               \
  place here = {&p, target + 3 * n * f->patch * f->patch, exemplar,                                                  \
                coarse_target + 3 * n * coarse_side * coarse_side, coarse, finer, histogram + n * f->levels * BINS,  \
                guide + (f->guided ? cell * GUIDE * GUIDE : 0), labels, sides_of(&p, i, j), i, j,                    \
                finer_unit, guide_unit};                                                                             \
  content c = {f, offsets, starts, ranges, range_blocks, range_starts, key_map};

__kernel void quilting_score(PLAN_ARGS, PLACE_ARGS, CONTENT_ARGS, __global uint *restrict candidate,
                             __global long *restrict cost) {
  int k = get_global_id(0), n = get_global_id(1);
  if (k >= f->candidates || n >= cells) return;
  BEGIN_PLACE
  uint at = candidate_of(&c, key, i, j, k, uses, cap);
  candidate[n * f->candidates + k] = at;
  cost[n * f->candidates + k] = at == NONE ? NO_COST : first_cost(&here, at);
}

// The best candidate, ties to the earlier one in the hash's order, moved to where it fits best nearby.
__kernel void quilting_best(PLAN_ARGS, PLACE_ARGS, CONTENT_ARGS, __global const uint *restrict candidate,
                            __global const long *restrict cost, __global uint *restrict best, int reach) {
  int n = get_global_id(0);
  if (n >= cells) return;
  BEGIN_PLACE
  const __global long *costs = cost + n * f->candidates;
  uint found = NONE;
  long least = NO_COST, last = -1;
  int last_k = -1;
  for (int rank = 0; rank < SHORTLIST; rank++) {
    int next = -1;   // the best that comes after the one before, by (cost, k)
    for (int k = 0; k < f->candidates; k++)
      if (costs[k] != NO_COST && (costs[k] > last || (costs[k] == last && k > last_k)) &&
          (next < 0 || costs[k] < costs[next]))
        next = k;
    if (next < 0) break;
    last = costs[next];
    last_k = next;
    uint at = candidate[n * f->candidates + next];
    long there = cost_at(&here, at);
    if (there < least) {
      least = there;
      found = at;
    }
  }
  for (int step = reach; step > 0 && found != NONE && least > 0 && here.sides; step /= 2) {
    int cy = corner_y(found), cx = corner_x(found);
    for (int k = 0; k < 9; k++) {
      int y = cy + step * (k / 3 - 1), x = cx + step * (k % 3 - 1);
      if (k == 4 || y < 0 || x < 0 || y >= f->e_rows || x >= f->e_columns) continue;
      if (key_map[y * f->e_columns + x] != (uint)key || uses[range_of(&c, key, corner(y, x))] >= cap[key]) continue;
      long there = cost_at(&here, corner(y, x));
      if (there < least) {
        least = there;
        found = corner(y, x);
      }
    }
  }
  best[n] = found;
}

// Cells take their patches one after another, so that no region is used more often than its cap. One work-item.
__kernel void quilting_assign(__constant facts *f, __global const uint *order, int first, int cells,
                              __global const int *keys, __global const uint *offsets, __global const int *starts,
                              __global const int *ranges, __global const int *range_blocks,
                              __global const int *range_starts, __global const uint *key_map, __global int *uses,
                              __global const int *cap, __global const uint *candidate, __global const long *cost,
                              __global const uint *best, __global uint *offset) {
  if (get_global_id(0) > 0) return;
  content c = {f, offsets, starts, ranges, range_blocks, range_starts, key_map};
  for (int n = 0; n < cells; n++) {
    uint cell = order[first + n], at = best[n];
    int key = keys[cell], range = at == NONE ? -1 : range_of(&c, key, at);
    if (range < 0 || uses[range] >= cap[key]) {   // it was free when the wave began
      long least = NO_COST;
      range = -1;
      for (int k = 0; k < f->candidates; k++) {
        long there = cost[n * f->candidates + k];
        if (there >= least) continue;
        int r = range_of(&c, key, candidate[n * f->candidates + k]);
        if (uses[r] >= cap[key]) continue;
        least = there;
        at = candidate[n * f->candidates + k];
        range = r;
      }
    }
    if (range < 0) {   // no candidate is free: the next region that is, from anywhere; there is one, see `caps`
      int many = ranges[key + 1] - ranges[key];
      uint bits = hash_at(f->seed, 0xCA9, cell / f->columns, cell % f->columns);
      range = ranges[key] + hash_below(bits, many);
      for (int k = 0; k < many && uses[range] >= cap[key]; k++)
        range = range + 1 < ranges[key + 1] ? range + 1 : ranges[key];
      at = offsets[range_starts[range] + hash_below(hash_pcg(bits), range_starts[range + 1] - range_starts[range])];
    }
    uses[range]++;
    offset[cell] = at;
  }
}

// --- cuts ---

// The minimum-error boundary cut of cell (i, j) in its left (or upper) overlap: Efros & Freeman 2001, section 2.1.
// table[s][t]: the least sum of squared differences along a path from the start to (s, t), s along the overlap, t
// across it. cut[s] is the first t that shows the new patch. Ties go to the path nearer to t = 0.
inline void cut(const plan *p, int i, int j, int upper, const __global short *exemplar, __global int *table,
                __global uchar *out) {
  __constant facts *f = p->f;
  int patch = f->patch, overlap = f->overlap;
  uint own = p->offset[i * f->columns + j];
  for (int s = 0; s < patch; s++)
    for (int t = 0; t < overlap; t++) {
      int lx = upper ? s : t, ly = upper ? t : s;
      uint a = old_source(p, i, j, lx, ly), b = own + corner(ly, lx);
      const __global short *old = exemplar + 3 * (corner_y(a) * f->e_width + corner_x(a));
      const __global short *new = exemplar + 3 * (corner_y(b) * f->e_width + corner_x(b));
      int error = 0;
      for (int c = 0; c < 3; c++) error += (old[c] - new[c]) * (old[c] - new[c]);
      if (s > 0) {
        const __global int *before = table + (s - 1) * overlap + t;
        int least = before[0];
        if (t > 0 && before[-1] < least) least = before[-1];
        if (t + 1 < overlap && before[1] < least) least = before[1];
        error += least;
      }
      table[s * overlap + t] = error;
    }
  int t = 0;
  for (int s = patch - 1; s >= 0; s--) {
    const __global int *row = table + s * overlap;
    int from = s == patch - 1 || t == 0 ? 0 : t - 1;
    int to = s == patch - 1 || t + 1 == overlap ? overlap - 1 : t + 1;
    t = from;
    for (int k = from + 1; k <= to; k++)
      if (row[k] < row[t]) t = k;
    out[s] = t;
  }
}

// pass 0: both cuts of the cells themselves; 1: the left cut of the cell to the right, where that lies already;
// 2: the upper cut of the cell below. They follow each other, because the later read what the earlier write.
__kernel void quilting_cut(__constant facts *f, __global const int *xs, __global const int *ys,
                           __global const uint *offset, __global uchar *vertical, __global uchar *horizontal,
                           __global const uint *order, int first, int cells, __global const short *restrict exemplar,
                           __global int *restrict table, int pass) {
  int upper = get_global_id(0), n = get_global_id(1);
  if (upper > 1 || n >= cells) return;
  plan p = {f, xs, ys, offset, vertical, horizontal};
  uint cell = order[first + n];
  int i = cell / f->columns, j = cell % f->columns, sides = sides_of(&p, i, j);
  if (pass == 0 && !(sides & (upper ? TOP : LEFT))) return;
  if (pass == 1 && (upper || !(sides & RIGHT))) return;
  if (pass == 2 && (!upper || !(sides & BOTTOM))) return;
  if (pass == 1) j = right_of(f, j);
  if (pass == 2) i = below(f, i);
  __global uchar *out = (upper ? horizontal : vertical) + (i * f->columns + j) * f->patch;
  cut(&p, i, j, upper, exemplar, table + (2 * n + upper) * f->patch * f->overlap, out);
}
