// Image quilting (Efros & Freeman 2001) as a plan: for every cell of a grid of patches, the exemplar patch and its
// minimum-error cuts against the cells before it. LSA16 section 6.1 chooses candidates by their content.
//
// A cell (i, j) has its top-left pixel at (xs[j], ys[i]) of the output. Its patch begins at offset[cell] of the
// exemplar (y << 16 | x); pixel (lx, ly) of it is visible where lx >= vertical[ly] and ly >= horizontal[lx]. Elsewhere
// the cell to the left is visible, subject to its own horizontal cut, else the row of cells above. So the plan gives
// the source of any output pixel, and no pixels are kept while it is computed.
//
// Images are rows of interleaved 16-bit (L, a, b) on an integer grid. All costs are integers.
#include "lanes.h"
#include "team.h"
#include "hash.h"
#include "offsets.h"
#include "lattice.h"

#define NONE 0xffffffffu
#define NO_COST LONG_MAX
#define DRAWS 4         // per candidate; the one with the lowest reuse penalty is taken
#define OVER 16         // units per excess use, squared in the penalty; quilting/quilter.py
#define MOST_OVER 1023  // excess uses are counted up to this
#define COARSE 4        // candidates are first compared in images reduced by this factor
#define SHORTLIST 8     // candidates that are compared at full resolution
#define BINS 256        // labels of finer levels are counted modulo this
#define LEVELS 3        // most levels whose labels are counted
#define LABEL_STEP 4    // labels are held for every 4th pixel, in both directions
#define GUIDE 4         // samples of the guide per side
#define COURSES 2       // value of facts.lattice: rows of unequal height; 1: a lattice
#define ROWS 3          // of a patch that are compared with its courses

// Constants of a run; see quilting/quilter.py, _FACTS.
typedef struct {
  int patch, overlap, width, height, columns, rows, wrap_x, wrap_y;
  int e_width, e_columns, e_rows, square, squares, before, squares_across, candidates, levels, stride, flush;
  uint seed;
  int guided, lattice, steps[4];
} facts;

typedef struct {
  __constant facts *f;
  __global const int *xs, *ys;
  __global const uint *offset;
  __global const uchar *vertical, *horizontal;
} plan;

static inline int left_of(__constant facts *f, int j) { return j > 0 ? j - 1 : f->wrap_x ? f->columns - 1 : -1; }
static inline int right_of(__constant facts *f, int j) { return j + 1 < f->columns ? j + 1 : f->wrap_x ? 0 : -1; }
static inline int above(__constant facts *f, int i) { return i > 0 ? i - 1 : f->wrap_y ? f->rows - 1 : -1; }
static inline int below(__constant facts *f, int i) { return i + 1 < f->rows ? i + 1 : f->wrap_y ? 0 : -1; }

// Distance of column b to its left neighbor a; rows likewise.
static inline int step_x(const plan *p, int a, int b) { return p->xs[b] - p->xs[a] + (b <= a ? p->f->width : 0); }
static inline int step_y(const plan *p, int a, int b) { return p->ys[b] - p->ys[a] + (b <= a ? p->f->height : 0); }

static inline uint placed(const plan *p, int i, int j) { return i < 0 || j < 0 ? NONE : p->offset[AT(i, j, p->f->columns)]; }

// The source of a pixel in the cells of row i only: (lx, ly) is relative to cell (i, j), and may be in the next ones.
static inline uint row_source(const plan *p, int i, int j, int lx, int ly) {
  for (;;) {
    int next = right_of(p->f, j);
    if (next < 0 || placed(p, i, next) == NONE) break;
    int step = step_x(p, j, next);
    if (lx < step) break;
    lx -= step;
    j = next;
  }
  if (lx < p->f->overlap && lx < p->vertical[AT(AT(i, j, p->f->columns), ly, p->f->patch)]) {
    int left = left_of(p->f, j);
    return placed(p, i, left) + corner(ly, lx + step_x(p, left, j));
  }
  return placed(p, i, j) + corner(ly, lx);
}

// The source of pixel (lx, ly) of cell (i, j) without the cell itself; only defined in its overlaps.
static inline uint old_source(const plan *p, int i, int j, int lx, int ly) {
  int left = left_of(p->f, j);
  if (lx < p->f->overlap && placed(p, i, left) != NONE) {
    int x = lx + step_x(p, left, j);
    size_t cell = AT(i, left, p->f->columns);
    if (ly >= p->horizontal[AT(cell, x, p->f->patch)]) return p->offset[cell] + corner(ly, x);
  }
  int up = above(p->f, i);
  return row_source(p, up, j, lx, ly + step_y(p, up, i));
}

// --- the plan as pixels ---

// The source of a pixel; column[x], row[y]: the last cell that begins at or before it.
__kernel void quilting_render(__constant facts *f, __global const int *xs, __global const int *ys,
                              __global const uint *offset, __global const uchar *vertical,
                              __global const uchar *horizontal, __global const int *column, __global const int *row,
                              __global uint *restrict source, int left, int top, int width, int height) {
  int x = get_global_id(0), y = get_global_id(1);
  if (x >= width || y >= height) return;
  plan p = {f, xs, ys, offset, vertical, horizontal};
  int j = column[x], i = row[y];
  int lx = left + x - xs[j], ly = top + y - ys[i];
  size_t cell = AT(i, j, f->columns);
  ly -= ly >= f->patch ? f->height : 0;   // on a torus, the first row overlaps the last one
  bool own = (lx >= f->overlap || lx >= vertical[AT(cell, ly, f->patch)]) &&
             (ly >= f->overlap || ly >= horizontal[AT(cell, lx, f->patch)]);
  source[AT(y, x, width)] = own ? offset[cell] + corner(ly, lx) : old_source(&p, i, j, lx, ly);
}

// --- overlaps of a cell ---

// Sides on which a cell overlaps placed cells. These include right and below where the torus closes, and for cells that
// are resynthesized.
#define LEFT 1
#define TOP 2
#define RIGHT 4
#define BOTTOM 8
static inline int sides_of(const plan *p, int i, int j) {
  return (placed(p, i, left_of(p->f, j)) != NONE ? LEFT : 0) | (placed(p, above(p->f, i), j) != NONE ? TOP : 0) |
         (placed(p, i, right_of(p->f, j)) != NONE ? RIGHT : 0) | (placed(p, below(p->f, i), j) != NONE ? BOTTOM : 0);
}

// Where the right and lower overlaps begin inside the patch.
static inline int right_at(const plan *p, int j) { return step_x(p, j, right_of(p->f, j)); }
static inline int bottom_at(const plan *p, int i) { return step_y(p, i, below(p->f, i)); }

// The source under pixel (lx, ly) of cell (i, j), NONE outside the overlaps.
static inline uint around(const plan *p, int sides, int i, int j, int lx, int ly) {
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

// The overlaps of a cell as an image of patch x patch pixels; other pixels are not written.
__kernel void quilting_target(__constant facts *f, __global const int *xs, __global const int *ys,
                              __global const uint *offset, __global const uchar *vertical,
                              __global const uchar *horizontal, __global const uint *order, int first,
                              __global const short *restrict exemplar, __global short *restrict target, int cells) {
  int ly = TEAM_NUMBER, n = get_global_id(1);
  if (ly >= f->patch || n >= cells) return;
  plan p = {f, xs, ys, offset, vertical, horizontal};
  uint cell = order[first + n];
  int i = cell / f->columns, j = cell % f->columns, sides = sides_of(&p, i, j);
  for (int lx = TEAM_RANK; lx < f->patch; lx += TEAM) {
    __global short *to = target + 3 * AT(AT(n, ly, f->patch), lx, f->patch);
    uint at = around(&p, sides, i, j, lx, ly);
    if (at == NONE) continue;
    const __global short *from = exemplar + 3 * AT(corner_y(at), corner_x(at), f->e_width);
    for (int c = 0; c < 3; c++) to[c] = from[c];
  }
}

// The overlaps reduced by COARSE; halves are rounded up, as in quilting.py, reduced.
__kernel void quilting_reduce(__constant facts *f, __global const short *restrict target,
                              __global short *restrict coarse, int cells) {
  int v = TEAM_NUMBER, n = get_global_id(1), side = f->patch / COARSE;
  if (v >= side || n >= cells) return;
  const __global short *from = target + 3 * AT(AT(n, COARSE * v, f->patch), 0, f->patch);
  __global short *to = coarse + 3 * AT(AT(n, v, side), 0, side);
  for (int u = TEAM_RANK; u < side; u += TEAM)
    for (int c = 0; c < 3; c++) {
      int sum = 0;
      for (int y = 0; y < COARSE; y++)
        for (int x = 0; x < COARSE; x++) sum += from[3 * (y * f->patch + COARSE * u + x) + c];
      to[3 * u + c] = (short)((sum + 8) >> 4);
    }
}

// Index of an exemplar pixel's labels.
static inline size_t label_at(__constant facts *f, int y, int x) {
  return AT(y / LABEL_STEP, x / LABEL_STEP, (f->e_width + LABEL_STEP - 1) / LABEL_STEP);
}

// Bins of labels: an item on a CPU counts in private memory, a team in local memory.
#if LANES > 1
#define BINS_OF(name) short name[LEVELS * BINS]
typedef short *counts;
static inline void one_more(counts bins, int bin) { bins[bin]++; }
static inline int one_less(counts bins, int bin) { return bins[bin]--; }
#else
#define BINS_OF(name) __local int name[LEVELS * BINS]
typedef volatile __local int *counts;
static inline void one_more(counts bins, int bin) { atomic_inc(bins + bin); }
static inline int one_less(counts bins, int bin) { return atomic_dec(bins + bin); }
#endif

// Histograms of the finer levels' labels over the overlaps (LSA16 eq. 9), from samples `stride` px apart.
__kernel void quilting_histogram(__constant facts *f, __global const int *xs, __global const int *ys,
                                 __global const uint *offset, __global const uchar *vertical,
                                 __global const uchar *horizontal, __global const uint *order, int first,
                                 __global const uchar *restrict finer, __global short *restrict histogram, int cells) {
  int level = TEAM_NUMBER, n = get_global_id(1);
  BINS_OF(bins);
  if (level >= f->levels || n >= cells) return;
  plan p = {f, xs, ys, offset, vertical, horizontal};
  uint cell = order[first + n];
  int i = cell / f->columns, j = cell % f->columns, sides = sides_of(&p, i, j), begin = f->stride / 2;
  for (int b = TEAM_RANK; b < BINS; b += TEAM) bins[b] = 0;
  TEAM_SYNC(CLK_LOCAL_MEM_FENCE);
  for (int ly = begin; ly < f->patch; ly += f->stride)
    for (int lx = begin + TEAM_RANK * f->stride; lx < f->patch; lx += TEAM * f->stride) {
      uint at = around(&p, sides, i, j, lx, ly);
      if (at != NONE) one_more(bins, finer[label_at(f, corner_y(at), corner_x(at)) * f->levels + level]);
    }
  TEAM_SYNC(CLK_LOCAL_MEM_FENCE);
  __global short *out = histogram + AT(n, level, f->levels) * BINS;
  for (int b = TEAM_RANK; b < BINS; b += TEAM) out[b] = (short)bins[b];
}

// --- cost of a candidate ---

// An item's part of the sum of squared differences over a rectangle; `flush` rows fit 32 bits.
static inline long strip_distance(const __global short *t, const __global short *e, int t_row, int e_row, int n, int rows,
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
      int k = TEAM_RANK;
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
      for (; k < n; k += TEAM) {
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
static inline long overlap_distance(int sides, const __global short *t, const __global short *e, int patch, int overlap,
                             int e_width, int bottom, int rows, int right, int columns, int flush) {
  int t_row = 3 * patch, e_row = 3 * e_width, from = sides & TOP ? overlap : 0, left = sides & LEFT ? overlap : 0;
  long sum = 0;
  if (sides & TOP) sum += strip_distance(t, e, t_row, e_row, 3 * patch, overlap, flush);
  if (sides & LEFT)
    sum += strip_distance(t + from * t_row, e + from * e_row, t_row, e_row, 3 * overlap, patch - from, flush);
  if (sides & BOTTOM)
    sum += strip_distance(t + bottom * t_row + 3 * left, e + bottom * e_row + 3 * left, t_row, e_row,
                          3 * (patch - left), rows, flush);
  if (sides & RIGHT) {   // above the lower strip, and below it on a small torus
    int to = sides & BOTTOM ? bottom : patch, rest = to + rows;
    t += 3 * right;
    e += 3 * right;
    sum += strip_distance(t + from * t_row, e + from * e_row, t_row, e_row, 3 * columns, to - from, flush);
    if (rest < patch)
      sum += strip_distance(t + rest * t_row, e + rest * e_row, t_row, e_row, 3 * columns, patch - rest, flush);
  }
  return sum;
}

// Everything needed for the cost of a candidate in a cell. Each item computes its part of the costs.
typedef struct {
  const plan *p;
  const __global short *target, *exemplar, *coarse_target, *coarse;
  const __global uchar *finer;
  const __global short *histogram;
  const __global ushort *guide, *labels;
  int sides, i, j;
  const __global int *shown, *shares;
  int progress;
  __constant uint *phases;
  const __global int *losses;
  long finer_unit, guide_unit, use_unit, step_unit;
} place;

// The first square that is visible in a patch.
static inline size_t first_square(__constant facts *f, uint at) {
  int to = f->before + f->square / 2;
  return AT((corner_y(at) + to) / f->square, (corner_x(at) + to) / f->square, f->squares_across);
}

// An item's part of the reuse penalty of a patch: the squared excess uses of each of its squares, relative to the number
// of placed patches (quilting/repetition.py).
static inline long use_share(__constant facts *f, const __global int *shown, const __global int *shares, int progress,
                             uint at, int rank, int team) {
  size_t first = first_square(f, at);
  long sum = 0;
  for (int y = 0; y < f->squares; y++)
    for (int x = rank; x < f->squares; x += team) {
      size_t square = first + AT(y, x, f->squares_across);
      long due = (long)shares[square] * progress >> 16;
      long over = (256l * shown[square] - (due > 256 ? due : 256)) / (256 / OVER);
      over = over < 0 ? 0 : over > MOST_OVER ? MOST_OVER : over;
      sum += over * over;
    }
  return sum;
}

// Penalty for a candidate with another phase on the exemplar's lattice than the cell.
static inline long step_cost(const place *at, uint candidate) {
  const plan *p = at->p;
  if (!p->f->lattice) return 0;
  int x = p->xs[at->j], y = p->ys[at->i], ex = corner_x(candidate), ey = corner_y(candidate);
  if (p->f->lattice == COURSES) {   // a patch holds several joints, which are not evenly apart
    long sum = 0;
    for (int k = 0; k < ROWS; k++) {
      int to = k * (p->f->patch - 1) / (ROWS - 1);
      sum += price_of_courses(at->phases, at->losses, x + to, y + to, ex + to, ey + to);
    }
    return at->step_unit * (sum / ROWS);
  }
  return at->step_unit * price_of_offset(at->phases, at->losses, x, y, ex, ey);
}

// Penalties in addition to color: excess labels of finer levels in the overlaps (as many as are missing), and samples
// whose label differs from the guide.
MEETING long label_cost(const place *at, int ey, int ex, int bottom, int right, counts bins) {
  __constant facts *f = at->p->f;
  int patch = f->patch, overlap = f->overlap, apart = 0, wrong = 0, levels = at->sides ? f->levels : 0;
  for (int b = TEAM_RANK; b < levels * BINS; b += TEAM) bins[b] = at->histogram[b];
  TEAM_SYNC(CLK_LOCAL_MEM_FENCE);
  for (int level = 0; level < levels; level++)
    for (int ly = f->stride / 2; ly < patch; ly += f->stride) {
      int whole = ((at->sides & TOP) && ly < overlap) || (ly >= bottom && ly < bottom + overlap);
      for (int lx = f->stride / 2 + TEAM_RANK * f->stride; lx < patch; lx += TEAM * f->stride) {
        if (!whole && !((at->sides & LEFT) && lx < overlap) && !(lx >= right && lx < right + overlap)) {
          if (right == patch) break;   // end of the row
          continue;
        }
        int bin = at->finer[label_at(f, ey + ly, ex + lx) * f->levels + level];
        apart += one_less(bins + level * BINS, bin) > 0 ? 0 : 1;
      }
    }
  TEAM_SYNC(CLK_LOCAL_MEM_FENCE);
  for (int k = TEAM_RANK; f->guided && k < GUIDE * GUIDE; k += TEAM) {
    int y = (2 * (k / GUIDE) + 1) * patch / (2 * GUIDE), x = (2 * (k % GUIDE) + 1) * patch / (2 * GUIDE);
    ushort wanted = at->guide[k];
    wrong += wanted != 0 && wanted != at->labels[label_at(f, ey + y, ex + x)];
  }
  return at->finer_unit * apart + at->guide_unit * wrong;
}

MEETING long cost_at(const place *at, uint candidate, counts bins) {
  __constant facts *f = at->p->f;
  int ey = corner_y(candidate), ex = corner_x(candidate);
  int bottom = at->sides & BOTTOM ? bottom_at(at->p, at->i) : f->patch;
  int right = at->sides & RIGHT ? right_at(at->p, at->j) : f->patch;
  return label_cost(at, ey, ex, bottom, right, bins) +
         overlap_distance(at->sides, at->target, at->exemplar + 3 * AT(ey, ex, f->e_width), f->patch, f->overlap,
                          f->e_width, bottom, min(f->patch - bottom, f->overlap), right,
                          min(f->patch - right, f->overlap), f->flush);
}

// The same in images reduced by COARSE, which fit a cache: it rejects most candidates.
MEETING long first_cost(const place *at, uint candidate, counts bins) {
  __constant facts *f = at->p->f;
  int ey = corner_y(candidate), ex = corner_x(candidate);
  int bottom = at->sides & BOTTOM ? bottom_at(at->p, at->i) : f->patch;
  int right = at->sides & RIGHT ? right_at(at->p, at->j) : f->patch;
  int patch = f->patch / COARSE, width = f->e_width / COARSE;
  int y = (ey + COARSE / 2) / COARSE, x = (ex + COARSE / 2) / COARSE;
  int most_y = (f->e_rows + f->patch - 1) / COARSE - patch, most_x = width - patch;
  y = y < most_y ? y : most_y;
  x = x < most_x ? x : most_x;
  // in the lower and right overlaps only complete squares
  int low = (bottom + COARSE - 1) / COARSE, low_end = min((bottom + f->overlap) / COARSE, patch);
  int far = (right + COARSE - 1) / COARSE, far_end = min((right + f->overlap) / COARSE, patch);
  low = min(low, patch);
  far = min(far, patch);
  return label_cost(at, ey, ex, bottom, right, bins) +
         COARSE * COARSE * overlap_distance(at->sides, at->coarse_target, at->coarse + 3 * AT(y, x, width), patch,
                                            f->overlap / COARSE, width, low, max(low_end - low, 0), far,
                                            max(far_end - far, 0), f->flush);
}

// --- the content table ---

typedef struct {
  __constant facts *f;
  const __global uint *offsets;                            // by key
  const __global int *spans;                               // per key: begin and end of its offsets; begin and end of its keys
  const __global uint *key_map;
} content;

// Whether this key permits a patch.
static inline int has_key(const content *c, int key, int y, int x) {
  if (y < 0 || x < 0 || y >= c->f->e_rows || x >= c->f->e_columns) return 0;
  uint there = c->key_map[AT(y, x, c->f->e_columns)];
  return there >= (uint)c->spans[4 * key + 2] && there < (uint)c->spans[4 * key + 3];
}

// Candidate k of a cell: all offsets of its key from a random start on, or a sample if there are too many; every other
// one is shifted to be in phase with the lattice.
static inline uint candidate_of(const content *c, const place *at, int key, int k, int draw) {
  __constant facts *f = c->f;
  int first = c->spans[4 * key], count = c->spans[4 * key + 1] - first;
  if (count <= f->candidates) {
    int pick = k + hash_below(hash_at(f->seed, 0x917, at->i, at->j), count);
    return k < count && draw == 0 ? c->offsets[first + (pick >= count ? pick - count : pick)] : NONE;
  }
  uint drawn = c->offsets[first + hash_below(hash_at(f->seed, 0x10000u + DRAWS * k + draw, at->i, at->j), count)];
  if (!f->lattice || k % 2) return drawn;
  int ey = corner_y(drawn), ex = corner_x(drawn);
  int x = at->p->xs[at->j], y = at->p->ys[at->i], middle = f->patch / 2;
  int2 off = f->lattice == COURSES
                 ? (int2)(phase_of_courses(at->phases, at->losses, x + middle, y + middle, ex + middle, ey + middle), 0)
                 : phases_of_offset(at->phases, x, y, ex, ey);
  ex -= (int)(((long)off.x * f->steps[0] + (long)off.y * f->steps[2] + (1l << 39)) >> 40);
  ey -= (int)(((long)off.x * f->steps[1] + (long)off.y * f->steps[3] + (1l << 39)) >> 40);
  return has_key(c, key, ey, ex) ? corner(ey, ex) : drawn;
}

#define PLAN_ARGS __constant facts *f, __global const int *xs, __global const int *ys, __global const uint *offset, \
                  __global const uchar *vertical, __global const uchar *horizontal
#define PLACE_ARGS __global const uint *order, int first, int cells, __global const int *keys,                        \
                   __global const short *target, __global const short *exemplar,                                     \
                   __global const short *coarse_target, __global const short *coarse, __global const uchar *finer,   \
                   __global const short *histogram, __global const ushort *guide, __global const ushort *labels,     \
                   __global const int *shown, __global const int *shares, int progress, __constant uint *phases,     \
                   __global const int *losses, long finer_unit, long guide_unit, long use_unit, long step_unit
#define CONTENT_ARGS __global const uint *offsets, __global const int *spans, __global const uint *key_map
#define BEGIN_PLACE                                                                                                  \
  plan p = {f, xs, ys, offset, vertical, horizontal};                                                                \
  uint cell = order[first + n];                                                                                      \
  int i = cell / f->columns, j = cell % f->columns, key = keys[cell];                                                \
  int coarse_side = f->patch / COARSE;                                                                               \
  place here = {&p, target + 3 * AT(n, 0, f->patch) * f->patch, exemplar,                                            \
                coarse_target + 3 * AT(n, 0, coarse_side) * coarse_side, coarse, finer,                              \
                histogram + AT(n, 0, f->levels) * BINS,                                                              \
                guide + (f->guided ? (size_t)cell * GUIDE * GUIDE : 0), labels, sides_of(&p, i, j), i, j,            \
                shown, shares, progress, phases, losses, finer_unit, guide_unit, use_unit, step_unit};               \
  content c = {f, offsets, spans, key_map};

// `cost` excludes `price`, the reuse penalty at the beginning of the wave.
__kernel void quilting_score(PLAN_ARGS, PLACE_ARGS, CONTENT_ARGS, __global uint *restrict candidate,
                             __global long *restrict cost, __global long *restrict price) {
  int k = TEAM_NUMBER, n = get_global_id(1);
  BINS_OF(bins);
  TEAM_SHARED(shared);
  if (k >= f->candidates || n >= cells) return;
  BEGIN_PLACE
  uint at = NONE;
  long there = NO_COST, use = 0;
  for (int draw = 0; draw < DRAWS; draw++) {
    uint next = candidate_of(&c, &here, key, k, draw);
    if (TEAM == 1 && next == NONE) break;
    long now = team_total(use_share(f, shown, shares, progress, next == NONE ? 0 : next, TEAM_RANK, TEAM), shared);
    if (next != NONE && (at == NONE || now < use)) {
      at = next;
      use = now;
    }
    if (TEAM == 1 && use == 0) break;
  }
  if (TEAM > 1 || at != NONE) there = team_total(first_cost(&here, at == NONE ? 0 : at, bins), shared);
  if (TEAM_RANK > 0) return;
  size_t into = AT(n, k, f->candidates);
  candidate[into] = at;
  cost[into] = at == NONE ? NO_COST : there + step_cost(&here, at);
  price[into] = at == NONE ? 0 : use_unit * use;
}

// The minimum over the items' (cost, number), ties to the lower number, -1 for none; returned to all items.
#if LANES > 1
#define TEAM_SEEN(name)
#define team_least(cost, number, seen)
#else
typedef struct { long cost[TEAM]; int number[TEAM]; } seen_by_team;
#define TEAM_SEEN(name) __local seen_by_team name
static inline int comes_first(long cost, int number, long than_cost, int than) {
  return number >= 0 && (than < 0 || cost < than_cost || (cost == than_cost && number < than));
}
MEETING void team_least_of(long *cost, int *number, __local seen_by_team *seen) {
  seen->cost[TEAM_RANK] = *cost;
  seen->number[TEAM_RANK] = *number;
  for (int apart = TEAM / 2; apart > 0; apart /= 2) {
    barrier(CLK_LOCAL_MEM_FENCE);
    int other = TEAM_RANK + apart;
    if (TEAM_RANK < apart &&
        comes_first(seen->cost[other], seen->number[other], seen->cost[TEAM_RANK], seen->number[TEAM_RANK])) {
      seen->cost[TEAM_RANK] = seen->cost[other];
      seen->number[TEAM_RANK] = seen->number[other];
    }
  }
  barrier(CLK_LOCAL_MEM_FENCE);
  *cost = seen->cost[0];
  *number = seen->number[0];
  barrier(CLK_LOCAL_MEM_FENCE);   // before the next write
}
#define team_least(cost, number, seen) team_least_of(&(cost), &(number), &(seen))
#endif

// The best candidate, ties to the earlier one in hash order, refined by a local search; and its number.
__kernel void quilting_best(PLAN_ARGS, PLACE_ARGS, CONTENT_ARGS, __global const uint *restrict candidate,
                            __global const long *restrict cost, __global const long *restrict price,
                            __global uint *restrict best, __global int *restrict best_number, int reach) {
  int n = TEAM_NUMBER;
  BINS_OF(bins);
  TEAM_SHARED(shared);
  TEAM_SEEN(seen);
  if (n >= cells) return;
  BEGIN_PLACE
  const __global long *costs = cost + AT(n, 0, f->candidates), *prices = price + AT(n, 0, f->candidates);
  uint found = NONE;
  long least = NO_COST, last = -1;
  int last_k = -1, number = -1;
  for (int rank = 0; rank < SHORTLIST; rank++) {
    int next = -1;   // the next best after the previous one, by (cost, k)
    long next_cost = NO_COST;
    for (int k = TEAM_RANK; k < f->candidates; k += TEAM) {
      if (costs[k] == NO_COST) continue;
      long total = costs[k] + prices[k];
      if ((total > last || (total == last && k > last_k)) && total < next_cost) {
        next = k;
        next_cost = total;
      }
    }
    team_least(next_cost, next, seen);
    if (TEAM == 1 && next < 0) break;   // all items of a team must reach the barrier in every iteration
    last = next_cost;
    last_k = next;
    uint at = candidate[AT(n, max(next, 0), f->candidates)];
    long there = team_total(cost_at(&here, next < 0 ? 0 : at, bins), shared);
    there += next < 0 ? 0 : prices[next] + step_cost(&here, at);
    if (next >= 0 && there < least) {
      least = there;
      found = at;
      number = next;
    }
  }
  int wanted = found != NONE && here.sides;
  for (int step = TEAM > 1 || wanted ? reach : 0; step > 0; step /= 2) {
    int cy = corner_y(found), cx = corner_x(found), first_least = least > 0;
    for (int k = 0; k < 9; k++) {
      int y = cy + step * (k / 3 - 1), x = cx + step * (k % 3 - 1);
      int fits = wanted && first_least && k != 4 && has_key(&c, key, y, x);
      if (TEAM == 1 && !fits) continue;
      uint at = fits ? corner(y, x) : 0;
      long use = team_total(use_share(f, shown, shares, progress, at, TEAM_RANK, TEAM), shared);
      long there = team_total(cost_at(&here, at, bins), shared) + use_unit * use + step_cost(&here, at);
      if (fits && there < least) {
        least = there;
        found = at;
      }
    }
  }
  if (TEAM_RANK > 0) return;
  best[n] = found;
  best_number[n] = number;
}

// Cells take their patches sequentially: if pixels of the best patch were used since the beginning of the wave, its
// candidates are compared again, by their coarse costs and the current reuse penalty. One team.
__kernel void quilting_assign(__constant facts *f, __global const uint *order, int first, int cells,
                              __global int *shown, __global const int *shares, int progress, long use_unit,
                              __global const uint *candidate, __global const long *cost, __global const long *price,
                              __global const uint *best, __global const int *best_number, __global uint *offset) {
  TEAM_SEEN(seen);
  TEAM_SHARED(shared);
  if (TEAM_NUMBER > 0) return;
  for (int n = 0; n < cells; n++) {
    uint at = best[n];
    int number = best_number[n];
    const __global uint *candidates = candidate + AT(n, 0, f->candidates);
    const __global long *costs = cost + AT(n, 0, f->candidates);
    long use = use_unit * team_total(use_share(f, shown, shares, progress, at, TEAM_RANK, TEAM), shared);
    if (use > price[AT(n, number, f->candidates)]) {
      long least = NO_COST;
      int least_k = -1;
      for (int k = TEAM_RANK; k < f->candidates; k += TEAM) {
        if (costs[k] == NO_COST) continue;
        long now = k == number ? use : use_unit * use_share(f, shown, shares, progress, candidates[k], 0, 1);
        if (costs[k] + now < least) {
          least = costs[k] + now;
          least_k = k;
        }
      }
      team_least(least, least_k, seen);
      at = least_k == number ? at : candidates[least_k];
    }
    TEAM_SYNC(CLK_GLOBAL_MEM_FENCE);   // all items have read
    if (TEAM_RANK == 0) offset[order[first + n]] = at;
    __global int *squares = shown + first_square(f, at);
    for (int y = 0; y < f->squares; y++)
      for (int x = TEAM_RANK; x < f->squares; x += TEAM) squares[AT(y, x, f->squares_across)]++;
    TEAM_SYNC(CLK_GLOBAL_MEM_FENCE);
  }
}

// --- cuts ---

// The minimum-error boundary cut of cell (i, j) in its left (or upper) overlap: Efros & Freeman 2001, section 2.1.
// table[s][t]: the least sum of squared differences along a path from the start to (s, t), s along the overlap, t
// across it. cut[s] is the first t where the new patch is visible. Ties go to the path nearer to t = 0.
static inline void cut(const plan *p, int i, int j, int upper, const __global short *exemplar, __global int *table,
                __global uchar *out) {
  __constant facts *f = p->f;
  int patch = f->patch, overlap = f->overlap;
  uint own = p->offset[AT(i, j, f->columns)];
  for (int s = 0; s < patch; s++) {
    for (int t = TEAM_RANK; t < overlap; t += TEAM) {
      int lx = upper ? s : t, ly = upper ? t : s;
      uint a = old_source(p, i, j, lx, ly), b = own + corner(ly, lx);
      const __global short *old = exemplar + 3 * AT(corner_y(a), corner_x(a), f->e_width);
      const __global short *new = exemplar + 3 * AT(corner_y(b), corner_x(b), f->e_width);
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
    TEAM_SYNC(CLK_GLOBAL_MEM_FENCE);
  }
  if (TEAM_RANK > 0) return;
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

// pass 0: both cuts of the cells themselves; 1: the left cut of the cell to the right, if it is placed; 2: the upper cut
// of the cell below. Passes run in this order, because later ones read the results of earlier ones.
__kernel void quilting_cut(__constant facts *f, __global const int *xs, __global const int *ys,
                           __global const uint *offset, __global uchar *vertical, __global uchar *horizontal,
                           __global const uint *order, int first, int cells, __global const short *restrict exemplar,
                           __global int *restrict table, int pass) {
  int upper = TEAM_NUMBER, n = get_global_id(1);
  if (upper > 1 || n >= cells) return;
  plan p = {f, xs, ys, offset, vertical, horizontal};
  uint cell = order[first + n];
  int i = cell / f->columns, j = cell % f->columns, sides = sides_of(&p, i, j);
  if (pass == 0 && !(sides & (upper ? TOP : LEFT))) return;
  if (pass == 1 && (upper || !(sides & RIGHT))) return;
  if (pass == 2 && (!upper || !(sides & BOTTOM))) return;
  if (pass == 1) j = right_of(f, j);
  if (pass == 2) i = below(f, i);
  __global uchar *out = (upper ? horizontal : vertical) + AT(AT(i, j, f->columns), 0, f->patch);
  cut(&p, i, j, upper, exemplar, table + AT(AT(n, upper, 2), 0, f->patch) * f->overlap, out);
}
