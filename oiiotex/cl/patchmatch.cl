// Toroidal PatchMatch, or k-coherence search, on Lab rounded to an integer grid: MJH17 section 4.2, after BSFG09.
//
// The field holds, for the patch at (x, y) of the target, the corner of its match in the exemplar. Images are 16-bit
// values: L, a, b, and those of further maps of the same material. The target is padded at its right and bottom by
// PATCH - 1 wrapped pixels, so that no distance needs a modulo.
// All costs are integers: decisions do not depend on the order of summation, the width of registers or the device.
// Buffers may hold a band of the target's rows: `first` is the row at the start of the band, counted beyond the border if
// the target wraps, and `top` the first row to compute. Both are 0 if all rows are held.
// Buffers of the exemplar may hold a piece: the patches whose first row is one of `e_from` to `e_to`. With PIECES a pass
// runs piece by piece, in any order: it compares matches in this piece with the best of the previous ones (`begun`).
#include "lanes.h"
#include "hash.h"
#include "offsets.h"
#include "lattice.h"

#define ROW (CHANNELS * PATCH)

#if PIECES
#define BEGUN , int begun
#define IN_PIECE(y) ((y) >= e_from && (y) < e_to)
#else
#define BEGUN
#define IN_PIECE(y) 1
#define begun 0
#endif

// If the exemplar has a lattice, matches out of phase with it cost more.
#if LATTICE
#define OFFSET_PRICES , __constant uint *phases, const __global int *restrict offset_prices
#if LATTICE == 2
#define OFFSET_PRICE(x, y, ex, ey) price_of_courses(phases, offset_prices, x, y, ex, ey)
#else
#define OFFSET_PRICE(x, y, ex, ey) price_of_offset(phases, offset_prices, x, y, ex, ey)
#endif
#else
#define OFFSET_PRICES
#define OFFSET_PRICE(x, y, ex, ey) 0
#endif

// Sum of squared differences of two patches, the inner integral of MJH17 eq. 5. It stops past `limit`, where no caller
// needs the exact value.
#if LANES == 1
static inline int patch_distance(const __global short *t, int t_row, const __global short *e, int e_row, int limit) {
  int sum = 0;
  for (int r = 0; r < PATCH && sum < limit; r++, t += t_row, e += e_row) {
    int8 squares = 0;
    for (int k = 0; k + 8 <= ROW; k += 8) {   // 16 bytes at once, on devices with unaligned loads
      int8 d = convert_int8(vload8(0, t + k) - vload8(0, e + k));
      squares += d * d;
    }
    int4 pairs = squares.lo + squares.hi;
    sum += pairs.x + pairs.y + pairs.z + pairs.w;
    for (int k = ROW / 8 * 8; k < ROW; k++) {
      int d = t[k] - e[k];
      sum += d * d;
    }
  }
  return sum;
}
#else
// Rows are processed in the widest registers that fit; registers are summed only after three rows (most bad candidates
// end there) and at the end.
#define WIDE(TYPE, at) (*(const __global TYPE *)(t + (at)) - *(const __global TYPE *)(e + (at)))
static inline int patch_distance(const __global short *t, int t_row, const __global short *e, int e_row, int limit) {
#if LANES > 16
  lane_i16 s32 = 0;
#endif
  lane_i8 s16 = 0;
  lane_i4 s8 = 0;
  int s1 = 0, sum = 0;
  for (int r = 0; r < PATCH; r++, t += t_row, e += e_row) {
    int k = 0;
#if LANES > 16
    for (; k + 32 <= ROW; k += 32) s32 += squares32(WIDE(lane_s32, k));
#endif
    for (; k + 16 <= ROW; k += 16) s16 += squares16(WIDE(lane_s16, k));
    for (; k + 8 <= ROW; k += 8) s8 += squares8(WIDE(lane_s8, k));
    for (; k < ROW; k++) {
      int d = t[k] - e[k];
      s1 += d * d;
    }
    if (r == 2 || r == PATCH - 1) {
      sum = s1 + total4(s8) + total8(s16);
#if LANES > 16
      sum += total16(s32);
#endif
      if (sum >= limit) return sum;
    }
  }
  return sum;
}
#endif

// The target with PATCH - 1 wrapped columns appended, and wrapped rows if `rows` exceeds its height.
__kernel void patchmatch_pad(const __global short *restrict image, __global short *restrict padded, int width, int height,
                             int rows) {
  int x = get_global_id(0), y = get_global_id(1), stride = width + PATCH - 1;
  if (x >= stride || y >= rows) return;
  const __global short *from = image + CHANNELS * AT(y < height ? y : y - height, x < width ? x : x - width, width);
  __global short *to = padded + CHANNELS * AT(y, x, stride);
  for (int c = 0; c < CHANNELS; c++) to[c] = from[c];
}

// Distances of the current field.
__kernel void patchmatch_score(const __global short *restrict target, const __global short *restrict exemplar,
                               const __global uint *restrict field, __global int *restrict distance,
                               int columns, int rows, int t_width, int e_width, int e_from, int e_to) {
  int x = get_global_id(0), y = get_global_id(1);
  if (x >= columns || y >= rows) return;
  size_t p = AT(y, x, columns);
  uint at = field[p];
  if (!IN_PIECE(corner_y(at))) return;
  distance[p] = patch_distance(target + CHANNELS * AT(y, x, t_width), CHANNELS * t_width,
      exemplar + CHANNELS * AT(corner_y(at) - e_from, corner_x(at), e_width), CHANNELS * e_width, INT_MAX);
}

// A match with its distance, and its cost: the distance plus the penalties of the exemplar patch at this place.
typedef struct { uint at; int distance, cost; } match;

// The penalties of the exemplar patch at (ex, ey) at (x, row), in addition to its distance. INT_MAX: not allowed.
#define EXTRA(ex, ey) add_sat(penalty[AT((ey) - e_from, ex, e_columns)], OFFSET_PRICE(x, row, ex, ey))

// Between passes the distance of a match is stored, since its penalty changes. With PIECES it is the cost: the penalty of
// a match may be in another piece than the match that it is compared with.
#if PIECES
#define PRESENT(field, distance) {(field)[p], 0, (distance)[p]}
#define KEPT(best) (best).cost

// Distances of the current field become costs.
__kernel void patchmatch_cost(const __global int *restrict penalty, const __global uint *restrict field,
                              __global int *restrict distance, int columns, int rows, int e_columns,
                              int e_from, int e_to, int first, int all_rows OFFSET_PRICES) {
  int x = get_global_id(0), y = get_global_id(1);
  if (x >= columns || y >= rows) return;
  size_t p = AT(y, x, columns);
  int row = WRAPPED(first + y, all_rows);
  uint at = field[p];
  if (IN_PIECE(corner_y(at))) distance[p] = add_sat(distance[p], EXTRA(corner_x(at), corner_y(at)));
}
#else
#define PRESENT(field, distance) \
  {(field)[p], (distance)[p], add_sat((distance)[p], EXTRA(corner_x((field)[p]), corner_y((field)[p])))}
#define KEPT(best) (best).distance
#endif

// The better of `best` and the exemplar patch at (ex, ey). A tie keeps `best`, unless `first` gives precedence to the
// other.
static inline match better_match(match best, int ex, int ey, int extra, const __global short *patch, int t_width,
                                 const __global short *exemplar, int e_width, int e_from, int first) {
  int most = best.cost - extra;
  if (extra >= best.cost && !(first && extra == best.cost)) return best;
  if (corner(ey, ex) == best.at) return best;
  int limit = most + first;
  int d = patch_distance(patch, CHANNELS * t_width, exemplar + CHANNELS * AT(ey - e_from, ex, e_width), CHANNELS * e_width,
                         limit);
  if (d >= limit) return best;
  match found = {corner(ey, ex), d, d + extra};
  return found;
}

// The candidate of a patch at (x, y) from its neighbor k of four, `jump` pixels away: the neighbor's match, shifted back.
#define NOTHING 0xffffffffu
static inline uint offered(const __global uint *restrict field, int x, int y, int k, int jump, int columns, int rows,
                           int wrap_x, int wrap_y, int e_columns, int e_rows) {
  int dx = k == 0 ? -jump : k == 1 ? jump : 0, dy = k == 2 ? -jump : k == 3 ? jump : 0;
  int nx = x + dx, ny = y + dy;
  if (nx < 0 || nx >= columns) {
    if (!wrap_x) return NOTHING;
    nx += nx < 0 ? columns : -columns;
  }
  if (ny < 0 || ny >= rows) {
    if (!wrap_y) return NOTHING;
    ny += ny < 0 ? rows : -rows;
  }
  uint other = field[AT(ny, nx, columns)];
  int ex = corner_x(other) - dx, ey = corner_y(other) - dy;
  return ex < 0 || ey < 0 || ex >= e_columns || ey >= e_rows ? NOTHING : corner(ey, ex);
}

// One Jacobi pass of propagation: every patch tries the matches of its four neighbors. Columns and rows of the field wrap
// if the target does (MJH17 section 4.2, toroidal boundary conditions). Computes rows `from` to `to` of a band of `rows`
// rows, which wrap if the band holds all of `all_rows`.
__kernel void patchmatch_propagate(const __global short *restrict target, const __global short *restrict exemplar,
                                   const __global int *restrict penalty,
                                   const __global uint *restrict field, const __global int *restrict distance,
                                   __global uint *restrict field_out, __global int *restrict distance_out,
                                   int columns, int rows, int t_width, int e_columns, int e_rows, int e_width, int e_from, int e_to,
                                   int jump, int wrap_x, int wrap_y, int from, int to, int first, int all_rows
                                   BEGUN OFFSET_PRICES) {
  int x = get_global_id(0), y = from + get_global_id(1);
  if (x >= columns || y >= to) return;
  size_t p = AT(y, x, columns);
  int row = WRAPPED(first + y, all_rows), rank = -1;
  const __global short *patch = target + CHANNELS * AT(y, x, t_width);
  match best = PRESENT(field, distance);
#if PIECES
  if (begun && field_out[p] != best.at) {   // which neighbor the best match came from: among equal costs the first wins
    best.at = field_out[p];
    best.cost = distance_out[p];
    for (rank = 0; offered(field, x, y, rank, jump, columns, rows, wrap_x, wrap_y, e_columns, e_rows) != best.at;) rank++;
  }
#endif
  uint offers[4];
  for (int k = 0; k < 4; k++) {
    uint at = offers[k] = offered(field, x, y, k, jump, columns, rows, wrap_x, wrap_y, e_columns, e_rows);
    if (at == NOTHING || at == best.at || !IN_PIECE(corner_y(at))) continue;
    int known = 0;   // most neighbors in a coherent field offer the same candidate
    for (int j = 0; j < k; j++) known |= offers[j] == at;
    if (known) continue;
    int ex = corner_x(at), ey = corner_y(at);
    match better = better_match(best, ex, ey, EXTRA(ex, ey), patch, t_width, exemplar, e_width, e_from, PIECES && k < rank);
#if PIECES
    if (better.at != best.at) rank = k;
#endif
    best = better;
  }
  field_out[p] = best.at;
  distance_out[p] = KEPT(best);
}

// Random search: one candidate in each of `searches` windows around the best so far, shrinking from the whole
// exemplar to about two pixels (BSFG09 section 3.2, exponential decay). With PIECES one search at a time, number `begin`:
// its window depends on all previous ones.
__kernel void patchmatch_search(const __global short *restrict target, const __global short *restrict exemplar,
                                const __global int *restrict penalty,
                                const __global uint *restrict field, const __global int *restrict distance,
                                __global uint *restrict field_out, __global int *restrict distance_out,
                                int columns, int t_width, int e_columns, int e_rows, int e_width, int e_from, int e_to,
                                __constant int *radius, int begin, int end, uint seed, uint step, int from, int to, int first
                                BEGUN OFFSET_PRICES) {
  int x = get_global_id(0), y = from + get_global_id(1);
  if (x >= columns || y >= to) return;
  size_t p = AT(y, x, columns);
  int row = first + y;
  const __global short *patch = target + CHANNELS * AT(y, x, t_width);
  match best = PRESENT(field, distance);
  uint bits = hash_at(seed, step, row, x);
  for (int k = 0; k < begin; k++) bits = hash_pcg(hash_pcg(bits + 2u * (uint)k + 1u) + 2u * (uint)k + 2u);
  for (int k = begin; k < end; k++) {
    int r = radius[k], bx = corner_x(best.at), by = corner_y(best.at);
    int x0 = bx > r ? bx - r : 0, x1 = bx + r < e_columns ? bx + r : e_columns - 1;
    int y0 = by > r ? by - r : 0, y1 = by + r < e_rows ? by + r : e_rows - 1;
    bits = hash_pcg(bits + 2u * (uint)k + 1u);
    int ex = x0 + hash_below(bits, x1 - x0 + 1);
    bits = hash_pcg(bits + 2u * (uint)k + 2u);
    int ey = y0 + hash_below(bits, y1 - y0 + 1);
    if (IN_PIECE(ey))
      best = better_match(best, ex, ey, EXTRA(ex, ey), patch, t_width, exemplar, e_width, e_from, 0);
    else if (begun) return;   // in another piece
  }
  field_out[p] = best.at;
  distance_out[p] = KEPT(best);
}

// The same without random numbers: candidates are the patches most similar to the best so far, by the `links` of its cell
// of `side` pixels (patch_search.py). They are moved as the best one is within its cell.
#define LINKS 8   // of each of `cells` in a row
__kernel void patchmatch_follow(const __global short *restrict target, const __global short *restrict exemplar,
                                const __global int *restrict penalty,
                                const __global uint *restrict field, const __global int *restrict distance,
                                __global uint *restrict field_out, __global int *restrict distance_out,
                                int columns, int t_width, int e_columns, int e_rows, int e_width, int e_from, int e_to,
                                const __global uint *restrict links, int begin, int end, uint side, uint cells,
                                int from, int to, int first BEGUN OFFSET_PRICES) {
  int x = get_global_id(0), y = from + get_global_id(1);
  if (x >= columns || y >= to) return;
  size_t p = AT(y, x, columns);
  int row = first + y;
  const __global short *patch = target + CHANNELS * AT(y, x, t_width);
  match best = PRESENT(field, distance);
  for (int k = begin; k < end; k++) {
    int bx = corner_x(best.at), by = corner_y(best.at), n = (int)side;
    uint link = links[LINKS * AT(by / n, bx / n, (int)cells) + k];
    int ex = corner_x(link) + bx % n, ey = corner_y(link) + by % n;
    if (ex >= e_columns || ey >= e_rows) continue;
    if (IN_PIECE(ey))
      best = better_match(best, ex, ey, EXTRA(ex, ey), patch, t_width, exemplar, e_width, e_from, 0);
    else if (begun) return;   // in another piece
  }
  field_out[p] = best.at;
  distance_out[p] = KEPT(best);
}

// --- spatial uniformity (MJH17 eq. 6, after KNL*15) ---

// Number of uses of each exemplar patch in the field.
__kernel void patchmatch_count(const __global uint *restrict field, __global int *restrict count, int columns, int rows, int e_columns,
                               int e_from, int e_to) {
  int x = get_global_id(0), y = get_global_id(1);
  if (x >= columns || y >= rows) return;
  uint at = field[AT(y, x, columns)];
  if (IN_PIECE(corner_y(at))) atomic_inc(count + AT(corner_y(at) - e_from, corner_x(at), e_columns));
}

// Uses of an exemplar pixel are the counts summed over the PATCH x PATCH patches that cover it; their mean over a patch
// is a second box sum. Both together are one separable triangle of width 2 PATCH - 1. With `many` uses of one patch, the
// sum may exceed an int.
#define TRIANGLE(NAME, SUM)                                                                               \
  static inline SUM NAME(const __global int *count, int at, int n, long stride) {                        \
    SUM sum = 0;                                                                                          \
    for (int k = 1; k <= PATCH; k++) { /* the rising side, with its peak, and the falling one */          \
      int before = at - PATCH + k, after = at + PATCH - k;                                                \
      if (before >= 0) sum += (SUM)k * count[before * stride];                                            \
      if (k < PATCH && after < n) sum += (SUM)k * count[after * stride];                                  \
    }                                                                                                     \
    return sum;                                                                                           \
  }
TRIANGLE(triangle, int)
TRIANGLE(wide_triangle, long)
// Along rows here,
__kernel void patchmatch_uses_rows(const __global int *restrict count, __global int *restrict uses, int e_columns, int e_rows,
                                   int many) {
  int x = get_global_id(0), y = get_global_id(1);
  if (x >= e_columns || y >= e_rows) return;
  size_t row = AT(y, 0, e_columns);
  if (many) {
    long sum = wide_triangle(count + row, x, e_columns, 1);
    uses[row + x] = sum < INT_MAX ? (int)sum : INT_MAX;
  } else {
    uses[row + x] = triangle(count + row, x, e_columns, 1);
  }
}
// and along columns here, where the sum becomes the reuse penalty of the patch: `price` times the uses of its pixels. A
// patch that is not allowed (it covers a transparent pixel) has a negative price. `counted` rows of uses are held, and
// `e_rows` of the others, which begin `above` rows further down.
__kernel void patchmatch_penalty(const __global int *restrict uses, const __global float *restrict price,
                                 __global int *restrict penalty, int e_columns, int e_rows, int counted, int above,
                                 int many, float weight) {
  int x = get_global_id(0), y = get_global_id(1);
  if (x >= e_columns || y >= e_rows) return;
  size_t p = AT(y, x, e_columns);
  float sum = many ? (float)wide_triangle(uses + x, y + above, counted, e_columns)
                   : (float)triangle(uses + x, y + above, counted, e_columns);
  float cost = weight * sum * price[p];
  penalty[p] = price[p] < 0.0f ? INT_MAX : cost < 1.0e9f ? (int)cost : 1000000000;
}

// --- voting ---

// Every target pixel becomes the mean of the patches over it, rounded to the grid (halves up).
static inline short mean_vote(int sum, int votes) {
  const int above = 4096;   // keeps the dividend positive, where C's division rounds down
  return (short)((2 * (sum + above * votes) + votes) / (2 * votes) - above);
}

// Patches from first to last cover pixel `at`; if the field wraps, all PATCH do.
#define FIRST(at, wrap) ((wrap) || (at) >= PATCH ? (at) - PATCH + 1 : 0)
#define LAST(at, n, wrap) ((wrap) || (at) < (n) ? (at) : (n) - 1)
// Votes of all pieces are added in `sums`; the last piece divides them.
#if PIECES
#define SUMS , __global int *restrict sums, int begun, int ended
#define VOTED(p, c, sum)                                                                                  \
  {                                                                                                       \
    int all = (sum) + (begun ? sums[CHANNELS * (p) + (c)] : 0);                                           \
    if (ended) image[CHANNELS * (p) + (c)] = mean_vote(all, votes);                                       \
    else sums[CHANNELS * (p) + (c)] = all;                                                                \
  }
#else
#define SUMS
#define VOTED(p, c, sum) image[CHANNELS * (p) + (c)] = mean_vote(sum, votes);
#endif
// Row v of the field within the held rows.
#define HELD(v) WRAPPED((v) - first_held, rows)

#if LANES == 1
__kernel void patchmatch_vote(const __global short *restrict exemplar, const __global uint *restrict field,
                              __global short *restrict image, int columns, int rows, int width,
                              int e_width, int wrap_x, int wrap_y, int top, int bottom, int first_held,
                              int e_from, int e_to SUMS) {
  int x = get_global_id(0), y = top + get_global_id(1);
  if (x >= width || y >= bottom) return;
  int sum[CHANNELS] = {0}, votes = 0;
  for (int v = FIRST(y, wrap_y); v <= LAST(y, rows, wrap_y); v++)
    for (int u = FIRST(x, wrap_x); u <= LAST(x, columns, wrap_x); u++, votes++) {
      uint at = field[AT(HELD(v), WRAPPED(u, columns), columns)];
      if (!IN_PIECE(corner_y(at))) continue;
      const __global short *e = exemplar + CHANNELS * AT(corner_y(at) - e_from + y - v, corner_x(at) + x - u, e_width);
      for (int c = 0; c < CHANNELS; c++) sum[c] += e[c];
    }
  size_t p = AT(y - top, x, width);
  for (int c = 0; c < CHANNELS; c++) VOTED(p, c, sum[c])
}
#else
// One item computes SPAN pixels of a row. The patches of one field column that cover the row vote for the same
// PATCH pixels, so their exemplar rows are summed in registers and added to the span once.
#define SPAN 64
__kernel void patchmatch_vote(const __global short *restrict exemplar, const __global uint *restrict field,
                              __global short *restrict image, int columns, int rows, int width,
                              int e_width, int wrap_x, int wrap_y, int top, int bottom, int first_held,
                              int e_from, int e_to SUMS) {
  int x0 = get_global_id(0) * SPAN, y = top + get_global_id(1);
  if (x0 >= width || y >= bottom) return;
  int sum[CHANNELS * (SPAN + 2 * PATCH)];
  for (int i = 0; i < CHANNELS * (SPAN + 2 * PATCH); i++) sum[i] = 0;
  int x1 = x0 + SPAN < width ? x0 + SPAN : width;
  int first = FIRST(y, wrap_y), last = LAST(y, rows, wrap_y);
  for (int u = FIRST(x0, wrap_x); u <= LAST(x1 - 1, columns, wrap_x); u++) {
    const __global uint *matches = field + WRAPPED(u, columns);
    short row[ROW];
    for (int k = 0; k < ROW; k++) row[k] = 0;
    for (int v = first; v <= last; v++) {
      uint at = matches[AT(HELD(v), 0, columns)];
      if (!IN_PIECE(corner_y(at))) continue;
      const __global short *e = exemplar + CHANNELS * AT(corner_y(at) - e_from + y - v, corner_x(at), e_width);
      for (int k = 0; k < ROW; k++) row[k] += e[k];   // fits 16 bits: see lab_grid.steps_for
    }
    int *into = sum + CHANNELS * (u - x0 + PATCH);
    for (int k = 0; k < ROW; k++) into[k] += row[k];
  }
  for (int x = x0; x < x1; x++) {
    int votes = (last - first + 1) * (LAST(x, columns, wrap_x) - FIRST(x, wrap_x) + 1);
    size_t p = AT(y - top, x, width);
    for (int c = 0; c < CHANNELS; c++) VOTED(p, c, sum[CHANNELS * (x - x0 + PATCH) + c])
  }
}
#endif

// The last vote picks, for every target pixel, the exemplar pixel with the most votes; patches with a nearer center
// have more weight. Means would blur (MJH17 section 4.2: the final image has original pixel values of the source).
// Ties go to the lower address.
#if LANES == 1
// Votes are recounted for every candidate, so that an item keeps only two numbers, of the best one. In a coherent field
// most candidates are the same.
__kernel void patchmatch_pick(const __global uint *restrict field, __constant int *weight, __global uint *restrict source,
                              int columns, int rows, int width, int wrap_x, int wrap_y,
                              int top, int bottom, int first_held) {
  int x = get_global_id(0), y = top + get_global_id(1);
  if (x >= width || y >= bottom) return;
  uint best = 0;
  int most = 0;
  for (int v = FIRST(y, wrap_y); v <= LAST(y, rows, wrap_y); v++)
    for (int u = FIRST(x, wrap_x); u <= LAST(x, columns, wrap_x); u++) {
      uint pixel = field[AT(HELD(v), WRAPPED(u, columns), columns)] + corner(y - v, x - u);
      if (most > 0 && pixel == best) continue;
      int votes = 0;
      for (int w = FIRST(y, wrap_y); w <= LAST(y, rows, wrap_y); w++)
        for (int t = FIRST(x, wrap_x); t <= LAST(x, columns, wrap_x); t++)
          if (field[AT(HELD(w), WRAPPED(t, columns), columns)] + corner(y - w, x - t) == pixel)
            votes += weight[(y - w) * PATCH + x - t];
      if (votes > most || (votes == most && pixel < best)) {
        best = pixel;
        most = votes;
      }
    }
  source[AT(y - top, x, width)] = best;
}
#else
// One item computes SPAN pixels of a row. Where all patches over a pixel were copied in one piece they agree, which
// columns of the field show: `run` counts those whose matches copy as the one before, from their copies at (y, x1).
__kernel void patchmatch_pick(const __global uint *restrict field, __constant int *weight, __global uint *restrict source,
                              int columns, int rows, int width, int wrap_x, int wrap_y,
                              int top, int bottom, int first_held) {
  int x0 = get_global_id(0) * SPAN, y = top + get_global_id(1);
  if (x0 >= width || y >= bottom) return;
  int x1 = x0 + SPAN < width ? x0 + SPAN : width, first = FIRST(y, wrap_y), last = LAST(y, rows, wrap_y);
  int run = 0, next = FIRST(x0, wrap_x);
  uint copied = 0;
  for (int x = x0; x < x1; x++) {
    for (; next <= LAST(x, columns, wrap_x); next++) {
      const __global uint *matches = field + WRAPPED(next, columns);
      uint own = matches[AT(HELD(first), 0, columns)] + corner(y - first, x1 - next);
      int alike = 1;
      for (int v = first + 1; v <= last; v++)
        alike &= matches[AT(HELD(v), 0, columns)] + corner(y - v, x1 - next) == own;
      run = !alike ? 0 : own == copied ? run + 1 : 1;
      copied = own;
    }
    __global uint *to = source + AT(y - top, x, width);
    if (run > LAST(x, columns, wrap_x) - FIRST(x, wrap_x)) {
      *to = copied - corner(0, x1 - x);
      continue;
    }
    uint choice[PATCH * PATCH];
    int votes[PATCH * PATCH], n = 0;
    for (int v = first; v <= last; v++)
      for (int u = FIRST(x, wrap_x); u <= LAST(x, columns, wrap_x); u++) {
        uint pixel = field[AT(HELD(v), WRAPPED(u, columns), columns)] + corner(y - v, x - u);
        int k = 0;
        while (k < n && choice[k] != pixel) k++;
        if (k == n) {
          choice[n] = pixel;
          votes[n++] = 0;
        }
        votes[k] += weight[(y - v) * PATCH + x - u];
      }
    int best = 0;
    for (int k = 1; k < n; k++)
      if (votes[k] > votes[best] || (votes[k] == votes[best] && choice[k] < choice[best])) best = k;
    *to = choice[best];
  }
}
#endif

// --- kept pixels ---

// Restores the prescribed pixels of a target. `held` is SHRT_MIN (histograms.OUTSIDE) where the target is free.
__kernel void patchmatch_hold(const __global short *restrict held, __global short *restrict image, int width, int height) {
  int x = get_global_id(0), y = get_global_id(1);
  if (x >= width || y >= height) return;
  size_t p = AT(y, x, width);
  if (held[CHANNELS * p] == SHRT_MIN) return;
  for (int c = 0; c < CHANNELS; c++) image[CHANNELS * p + c] = held[CHANNELS * p + c];
}

// Reduces a change near kept pixels: `changed` is moved to share / 255 of the way from `image` to it.
__kernel void patchmatch_ease(const __global short *restrict image, __global short *restrict changed,
                              const __global uchar *restrict share, int width, int height) {
  int x = get_global_id(0), y = get_global_id(1);
  if (x >= width || y >= height) return;
  size_t p = AT(y, x, width);
  for (int c = 0; c < CHANNELS; c++) {
    int from = image[CHANNELS * p + c], far = (changed[CHANNELS * p + c] - from) * share[p];
    changed[CHANNELS * p + c] = (short)(from + (far + (far < 0 ? -127 : 127)) / 255);
  }
}
