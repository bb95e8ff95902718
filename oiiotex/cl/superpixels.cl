// SLIC and statistics of superpixels: LSA16 section 3.
//
// Pixels are four 16-bit numbers: L, a, b in steps, and 1 if the pixel is opaque. The image is divided into the cells of
// the seed grid; a pixel belongs to one of the nine seeds of its cell and the neighboring cells. Its squared distance
// (LSA16 eq. 1) to each of them, minus a common term, is a linear function of (L, a, b, x, y) with integer coefficients
// from the host: a candidate. x and y are relative to the cell's reference pixel, shifted left by `shift`.
// Everything, including sums, is integers: results do not depend on order, register width, bands or device.
#include "lanes.h"
#include "offsets.h"
#include "team.h"

#define NONE 255        // the slot of transparent pixels
#define SUMS 6          // pixels, L, a, b, x, y
#define FAR 2147483647

// base, (L, a) as a pair of 16-bit numbers, (b, x) likewise, y
typedef int4 candidate;
// first row, row after the last, row of cells, reference row
typedef int4 strip;

static inline int low16(int v) { return v << 16 >> 16; }
static inline int high16(int v) { return v >> 16; }

// The slot (0 to 8, row by row) of every pixel, and sums over the pixels of each slot, for every cell of a strip of
// rows, relative to the cell's reference pixel. Inactive cells keep their sums. With `keep` the slots are stored, else
// the sums. `row0` is the first image row in `lab`; `first` is the first strip.
#if LANES == 1
__kernel void superpixels_clear(const __global strip *restrict strips, const __global uchar *restrict active,
                                __global int *restrict sums, int across, int count) {
  int gx = get_global_id(0), n = get_global_id(1);
  if (gx >= across || n >= count || !active[AT(strips[n].z, gx, across)]) return;
  for (int k = 0; k < 9 * SUMS; k++) sums[9 * SUMS * AT(n, gx, across) + k] = 0;
}
// One item processes one column of the strip and adds once per run of equal slots. Sums must be 0 before.
__kernel void superpixels_assign(const __global short4 *restrict lab, const __global candidate *restrict candidates,
                                 const __global strip *restrict strips, const __global int *restrict edges,
                                 const __global int *restrict cells, const __global uchar *restrict active,
                                 volatile __global int *restrict sums, __global uchar *restrict slots, int width,
                                 int across, int count, int shift, int row0, int first, int keep) {
  int x = get_global_id(0), n = get_global_id(1);
  if (x >= width || n >= count) return;
  strip s = strips[first + n];
  int gx = cells[x];
  size_t cell = AT(s.z, gx, across);
  if (!active[cell] && !keep) return;
  const __global candidate *near = candidates + 9 * cell;
  volatile __global int *into = sums + 9 * SUMS * AT(first + n, gx, across);
  int rx = x - (edges[gx] + edges[gx + 1]) / 2, present = NONE;
  int total[SUMS] = {0, 0, 0, 0, 0, 0};
  for (int y = s.x; y <= s.y; y++) {
    short4 v = 0;
    int slot = NONE, ry = y - s.w;
    if (y < s.y) {
      int best = FAR;
      size_t at = AT(y - row0, x, width);
      v = lab[at];
      for (int t = 0; t < 9; t++) {
        candidate c = near[t];
        int d = c.x + c.w * (ry << shift) + v.x * low16(c.y) + v.y * high16(c.y) + v.z * low16(c.z) +
                (rx << shift) * high16(c.z);
        slot = d < best ? t : slot;
        best = d < best ? d : best;
      }
      if (!v.w) slot = NONE;
      if (keep) slots[at] = (uchar)slot;
    }
    if (slot != present) {
      if (present != NONE && !keep)
        for (int k = 0; k < SUMS; k++) {
          atomic_add(into + SUMS * present + k, total[k]);
          total[k] = 0;
        }
      for (int k = 0; k < SUMS; k++) total[k] = 0;
      present = slot;
    }
    total[0]++; total[1] += v.x; total[2] += v.y; total[3] += v.z; total[4] += rx; total[5] += ry;
  }
}
#else
#define VW (LANES / 2)
#if VW == 16
typedef int iv __attribute__((ext_vector_type(16)));
typedef int iv2 __attribute__((ext_vector_type(32), aligned(4)));
typedef short sv2 __attribute__((ext_vector_type(32)));
typedef uchar ucv __attribute__((ext_vector_type(16), aligned(1)));
#define COUNT_UP (iv)(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15)
static inline int any_of(iv v) { int8 h = v.lo | v.hi; int4 q = h.lo | h.hi; int2 p = q.lo | q.hi; return p.x | p.y; }
#define total_of total16
#else
typedef int iv __attribute__((ext_vector_type(8)));
typedef int iv2 __attribute__((ext_vector_type(16), aligned(4)));
typedef short sv2 __attribute__((ext_vector_type(16)));
typedef uchar ucv __attribute__((ext_vector_type(8), aligned(1)));
#define COUNT_UP (iv)(0, 1, 2, 3, 4, 5, 6, 7)
static inline int any_of(iv v) { int4 q = v.lo | v.hi; int2 p = q.lo | q.hi; return p.x | p.y; }
#define total_of total8
#endif
// Products of adjacent 16-bit pairs added into 32 bits: this shape compiles to one multiply-add.
static inline iv dot2(iv a, iv b) {
  sv2 p = __builtin_astype(a, sv2), q = __builtin_astype(b, sv2);
  return __builtin_convertvector(p.even, iv) * __builtin_convertvector(q.even, iv) +
         __builtin_convertvector(p.odd, iv) * __builtin_convertvector(q.odd, iv);
}
// One item processes one cell of the strip. `lab` must be readable for VW pixels after its end.
__kernel void superpixels_assign(const __global int *restrict lab, const __global candidate *restrict candidates,
                                 const __global strip *restrict strips, const __global int *restrict edges,
                                 const __global int *restrict cells, const __global uchar *restrict active,
                                 __global int *restrict sums, __global uchar *restrict slots, int width,
                                 int across, int count, int shift, int row0, int first, int keep) {
  int gx = get_global_id(0), n = get_global_id(1);
  if (gx >= across || n >= count) return;
  strip s = strips[first + n];
  size_t cell = AT(s.z, gx, across);
  int x0 = edges[gx], x1 = edges[gx + 1], middle = (x0 + x1) / 2;
  if (!active[cell] && !keep) return;
  const __global candidate *near = candidates + 9 * cell;
  iv total[9 * SUMS];
  if (!keep)
    for (int k = 0; k < 9 * SUMS; k++) total[k] = 0;
  for (int y = s.x; y < s.y; y++) {
    int base[9], ry = y - s.w;
    for (int t = 0; t < 9; t++) base[t] = near[t].x + near[t].w * (ry << shift);
    for (int x = x0; x < x1; x += VW) {
      size_t at = AT(y - row0, x, width);
      iv2 pixels = *(const __global iv2 *)(lab + 2 * at);
      iv la = pixels.even, bo = pixels.odd, rx = x - middle + COUNT_UP;
      iv bx = (bo & 0xffff) | (rx << shift << 16), best = FAR, slot = NONE;
      for (int t = 0; t < 9; t++) {
        iv d = base[t] + dot2(la, (iv)near[t].y) + dot2(bx, (iv)near[t].z);
        iv closer = d < best;
        slot = closer ? (iv)t : slot;
        best = closer ? d : best;
      }
      slot = (bo >> 16) == 0 ? (iv)NONE : slot;
      if (keep) {
        if (x + VW <= x1)
          *(__global ucv *)(slots + at) = __builtin_convertvector(slot, ucv);
        else
          for (int k = 0; k < x1 - x; k++) slots[at + k] = (uchar)slot[k];
        continue;
      }
      slot = x + COUNT_UP < x1 ? slot : (iv)NONE;
      iv L = la << 16 >> 16, a = la >> 16, b = bo << 16 >> 16;
      for (uint present = any_of(slot < 9 ? (iv)1 << slot : (iv)0); present; present &= present - 1) {
        int t = 31 - clz(present & -present);
        iv here = slot == t;
        iv *into = total + SUMS * t;
        into[0] -= here;
        into[1] += L & here;
        into[2] += a & here;
        into[3] += b & here;
        into[4] += rx & here;
        into[5] += (iv)ry & here;
      }
    }
  }
  if (keep) return;
  __global int *into = sums + 9 * SUMS * AT(first + n, gx, across);
  for (int k = 0; k < 9 * SUMS; k++) into[k] = total_of(total[k]);
}
#endif

// Sums over the strips of each active cell.
__kernel void superpixels_total(const __global int *restrict sums, const __global int *restrict first,
                                const __global uchar *restrict active, __global long *restrict totals, int across,
                                int down) {
  int gx = get_global_id(0), gy = get_global_id(1);
  if (gx >= across || gy >= down || !active[AT(gy, gx, across)]) return;
  __global long *total = totals + 9 * SUMS * AT(gy, gx, across);
  for (int k = 0; k < 9 * SUMS; k++) total[k] = 0;
  for (int n = first[gy]; n < first[gy + 1]; n++) {
    const __global int *from = sums + 9 * SUMS * AT(n, gx, across);
    for (int k = 0; k < 9 * SUMS; k++) total[k] += from[k];
  }
}

// --- the image in squares of `side` pixels ---

// Sums of L, a, b over the opaque pixels of squares, and their number, from row `first` of squares on: the input of the
// Gaussian stack.
__kernel void superpixels_reduce(const __global short4 *restrict lab, __global int4 *restrict reduced, int width,
                                 int row0, int rows, int side, int across, int first, int down) {
  int i = get_global_id(0), n = get_global_id(1);
  if (i >= across || n >= down) return;
  int4 sum = 0;
  for (int y = (first + n) * side - row0; y < (first + n + 1) * side - row0 && y < rows; y++)
    for (int x = i * side; x < (i + 1) * side && x < width; x++) {
      int4 v = convert_int4(lab[AT(y, x, width)]);
      if (v.w) sum += v;
    }
  reduced[AT(n, i, across)] = sum;
}

// Their means, halves up, as pixels for the first SLIC iterations; the fourth number is WHOLE if no pixel is missing.
#define WHOLE 2
__kernel void superpixels_means(const __global int4 *restrict reduced, __global short4 *restrict lab, int side,
                                int across, int first, int down) {
  int i = get_global_id(0), n = get_global_id(1);
  if (i >= across || n >= down) return;
  int4 sum = reduced[AT(n, i, across)];
  int twice = 2 * max(sum.w, 1);
  int4 high = 2 * sum + sum.w, low = high % twice;
  short4 mean = convert_short4((high - low - (low < 0 ? (int4)twice : (int4)0)) / twice);   // towards minus infinity
  mean.w = sum.w == side * side ? WHOLE : sum.w > 0;
  lab[AT(first + n, i, across)] = mean;
}

// The seeds chosen by a square and its eight neighbors: a bit for each of the nine slots, PARTLY if the square is not
// WHOLE. `rows` and `columns` hold the row and column of cells of a square.
#define PARTLY 512
__kernel void superpixels_seeds(const __global short4 *restrict lab, const __global uchar *restrict slots,
                                const __global int *restrict rows, const __global int *restrict columns,
                                __global ushort *restrict seeds, int width, int height) {
  int x = get_global_id(0), y = get_global_id(1);
  if (x >= width || y >= height) return;
  uint bits = lab[AT(y, x, width)].w == WHOLE ? 0 : PARTLY;
  for (int v = max(y - 1, 0); v <= min(y + 1, height - 1); v++)
    for (int u = max(x - 1, 0); u <= min(x + 1, width - 1); u++) {
      int slot = slots[AT(v, u, width)], dy = rows[v] - rows[y] + slot / 3, dx = columns[u] - columns[x] + slot % 3;
      if (slot != NONE && dy >= 0 && dy < 3 && dx >= 0 && dx < 3) bits |= 1u << (3 * dy + dx);
    }
  seeds[AT(y, x, width)] = (ushort)bits;
}

// The slot of every pixel after seeds have converged on squares of 1 << `bits` pixels: one of the `seeds` of the pixel's
// square. If there is only one, pixels are not read.
static inline int alone(uint some) { return some == PARTLY ? NONE : 31 - clz(some); }
#if LANES == 1
__kernel void superpixels_refine(const __global short4 *restrict lab, const __global candidate *restrict candidates,
                                 const __global strip *restrict strips, const __global int *restrict edges,
                                 const __global int *restrict cells, const __global ushort *restrict seeds,
                                 __global uchar *restrict slots, int width, int across, int count, int shift, int row0,
                                 int first, int bits, int squares) {
  int x = get_global_id(0), n = get_global_id(1);
  if (x >= width || n >= count) return;
  strip s = strips[first + n];
  int gx = cells[x], rx = x - (edges[gx] + edges[gx + 1]) / 2;
  const __global candidate *near = candidates + 9 * AT(s.z, gx, across);
  for (int y = s.x; y < s.y; y++) {
    uint some = seeds[AT(y >> bits, x >> bits, squares)];
    size_t at = AT(y - row0, x, width);
    int best = FAR, slot = alone(some), ry = y - s.w;
    if (some & (some - 1)) {
      short4 v = lab[at];
      slot = NONE;
      for (uint left = v.w ? some & (PARTLY - 1) : 0; left; left &= left - 1) {
        int t = 31 - clz(left & -left);
        candidate c = near[t];
        int d = c.x + c.w * (ry << shift) + v.x * low16(c.y) + v.y * high16(c.y) + v.z * low16(c.z) +
                (rx << shift) * high16(c.z);
        slot = d < best ? t : slot;
        best = d < best ? d : best;
      }
    }
    slots[at] = (uchar)slot;
  }
}
#else
// One item processes one cell of the strip, in each row by runs of squares with the same seeds.
__kernel void superpixels_refine(const __global int *restrict lab, const __global candidate *restrict candidates,
                                 const __global strip *restrict strips, const __global int *restrict edges,
                                 const __global int *restrict cells, const __global ushort *restrict seeds,
                                 __global uchar *restrict slots, int width, int across, int count, int shift, int row0,
                                 int first, int bits, int squares) {
  int gx = get_global_id(0), n = get_global_id(1);
  if (gx >= across || n >= count) return;
  strip s = strips[first + n];
  int x0 = edges[gx], x1 = edges[gx + 1], middle = (x0 + x1) / 2;
  const __global candidate *near = candidates + 9 * AT(s.z, gx, across);
  for (int y = s.x; y < s.y; y++) {
    const __global ushort *row = seeds + AT(y >> bits, 0, squares);
    size_t line = AT(y - row0, 0, width);
    int ry = y - s.w;
    for (int x = x0, end; x < x1; x = end) {
      uint some = row[x >> bits];
      for (end = x + (1 << bits); end < x1 && row[end >> bits] == some;) end += 1 << bits;
      end = min(end, x1);
      if (!(some & (some - 1))) {
        for (uchar slot = (uchar)alone(some); x < end; x++) slots[line + x] = slot;
        continue;
      }
      for (; x < end; x += VW) {
        size_t at = line + x;
        iv2 pixels = *(const __global iv2 *)(lab + 2 * at);
        iv la = pixels.even, bo = pixels.odd, rx = x - middle + COUNT_UP;
        iv bx = (bo & 0xffff) | (rx << shift << 16), best = FAR, slot = NONE;
        for (uint left = some & (PARTLY - 1); left; left &= left - 1) {
          int t = 31 - clz(left & -left);
          iv d = near[t].x + near[t].w * (ry << shift) + dot2(la, (iv)near[t].y) + dot2(bx, (iv)near[t].z);
          iv closer = d < best;
          slot = closer ? (iv)t : slot;
          best = closer ? d : best;
        }
        slot = (bo >> 16) == 0 ? (iv)NONE : slot;
        if (x + VW <= end)
          *(__global ucv *)(slots + at) = __builtin_convertvector(slot, ucv);
        else
          for (int k = 0; k < end - x; k++) slots[at + k] = (uchar)slot[k];
      }
    }
  }
}
#endif

// Adds the sums of the first five powers of L, a, b over each superpixel, one team per superpixel. Fourth and fifth
// powers are summed in two halves, the lower 32 bits separately, because they could exceed 64 bits.
// A superpixel's runs are (row, first column, column after the last), from starts[i] on.
#define POWERS 21
__kernel void superpixels_powers(const __global short4 *restrict lab, const __global int *restrict starts,
                                 const __global int *restrict runs, __global long *restrict powers, int superpixels,
                                 int width, int row0) {
  int i = TEAM_NUMBER;
  TEAM_SHARED(shared);
  if (i >= superpixels) return;
  long sum[POWERS];   // in registers, because all indices are constant
#pragma unroll
  for (int k = 0; k < POWERS; k++) sum[k] = 0;
  for (int r = starts[i]; r < starts[i + 1]; r++) {
    const __global int *run = runs + 3 * (size_t)r;
    const __global short *p = (const __global short *)(lab + AT(run[0] - row0, 0, width));
    for (int x = run[1] + TEAM_RANK; x < run[2]; x += TEAM)
#pragma unroll
      for (int c = 0; c < 3; c++) {
        long v = p[4 * x + c], v2 = v * v, v4 = v2 * v2, v5 = v4 * v;
        long *into = sum + 7 * c;
        into[0] += v;
        into[1] += v2;
        into[2] += v2 * v;
        into[3] += v4 & 0xffffffff;
        into[4] += v4 >> 32;
        into[5] += v5 & 0xffffffff;
        into[6] += v5 >> 32;
      }
  }
#pragma unroll
  for (int k = 0; k < POWERS; k++) {
    long total = team_total(sum[k], shared);
    if (TEAM_RANK == 0) powers[AT(i, k, POWERS)] += total;
  }
}

// --- the Gaussian stack (LSA16 section 3.3) over squares of `side` pixels ---
//
// Four planes of sums, L, a, b and the number of pixels, each with a margin of `margin` zeros: pixels beyond the border
// or transparent ones are missing, not black. Only + - * / in a fixed order: the same bits everywhere.

#pragma OPENCL FP_CONTRACT OFF

#if LANES == 1
#define FW 1
typedef float fv;
#else
#define FW 8
typedef float fv __attribute__((ext_vector_type(8), aligned(4)));
#endif

// Correlation with 2 radius + 1 taps along one axis (`step` is 1 along x, `stride` along y). One item computes FW
// squares; planes have room for the excess writes of wide registers. Columns from `width` on are written as 0.
__kernel void superpixels_blur(const __global float *restrict from, __global float *restrict to,
                                      __constant float *restrict taps, int radius, int width, int height, int stride,
                                      int plane, int margin, int step) {
  int x = get_global_id(0) * FW, y = get_global_id(1) % height, c = get_global_id(1) / height;
  if (x >= width || c >= 4) return;
  size_t at = c * (size_t)plane + AT(y + margin, x + margin, stride);
  const __global float *seen = from + at - (long)radius * step;
  fv sum = 0.0f;
  for (int k = 0; k <= 2 * radius; k++, seen += step) sum += taps[k] * *(const __global fv *)seen;
  if (x + FW <= width)
    *(__global fv *)(to + at) = sum;
#if FW > 1
  else
    for (int k = 0; k < width - x; k++) to[at + k] = sum[k];
#endif
}

// Sums of four squares become one.
__kernel void superpixels_halve(const __global float *restrict from, __global float *restrict to, int from_stride,
                                int from_plane, int width, int height, int stride, int plane, int margin) {
  int x = get_global_id(0), y = get_global_id(1) % height, c = get_global_id(1) / height;
  if (x >= width || c >= 4) return;
  const __global float *p = from + c * (size_t)from_plane + AT(2 * y + margin, 2 * x + margin, from_stride);
  to[c * (size_t)plane + AT(y + margin, x + margin, stride)] = (p[0] + p[1]) + (p[from_stride] + p[from_stride + 1]);
}

// The number of pixels of each superpixel in each square of its bounding box, one team per superpixel.
// A box is (first square column, first square row, columns, start of its table).
__kernel void superpixels_shares(const __global int4 *restrict boxes, const __global int *restrict starts,
                                 const __global int *restrict runs, __global ushort *restrict shares, int superpixels,
                                 int side) {
  int i = TEAM_NUMBER;
  if (i >= superpixels) return;
  int4 box = boxes[i];
#if TEAM == 1
  for (int k = box.w; k < boxes[i + 1].w; k++) shares[k] = 0;
  for (int r = starts[i]; r < starts[i + 1]; r++) {
    const __global int *run = runs + 3 * (size_t)r;
    __global ushort *row = shares + box.w + (run[0] / side - box.y) * box.z - box.x;
    int x = run[1], end = run[2];
    while (x < end) {
      int square = x / side, next = (square + 1) * side < end ? (square + 1) * side : end;
      row[square] += next - x;
      x = next;
    }
  }
#else   // an item processes one square after another: the runs, sorted by row, that cross it
  for (int k = TEAM_RANK; k < boxes[i + 1].w - box.w; k += TEAM) {
    int top = (box.y + k / box.z) * side, left = (box.x + k % box.z) * side, share = 0;
    int low = starts[i], high = starts[i + 1];
    while (low < high) {
      int middle = (low + high) / 2;
      if (runs[3 * middle] < top) low = middle + 1; else high = middle;
    }
    for (int r = low; r < starts[i + 1] && runs[3 * r] < top + side; r++) {
      int begin = runs[3 * r + 1] > left ? runs[3 * r + 1] : left;
      int end = runs[3 * r + 2] < left + side ? runs[3 * r + 2] : left + side;
      share += end > begin ? end - begin : 0;
    }
    shares[box.w + k] = (ushort)share;
  }
#endif
}

// Sums of the blurred image over each superpixel's pixels, one team per superpixel: an item sums row after row, and rows
// are added in order.
__kernel void superpixels_gather(const __global int4 *restrict boxes, const __global ushort *restrict shares,
                                 const __global float *restrict image, __global float4 *restrict sums, int superpixels,
                                 int stride, int plane, int margin) {
  int i = TEAM_NUMBER;
#if TEAM > 1
  __local float4 lines[TEAM];
#endif
  if (i >= superpixels) return;
  int4 box = boxes[i];
  int rows = (boxes[i + 1].w - box.w) / box.z;
  float4 sum = 0.0f;
  for (int first = 0; first < rows; first += TEAM) {
    int y = first + TEAM_RANK;
    float4 line = 0.0f;
    for (int x = 0; y < rows && x < box.z; x++) {
      float share = (float)shares[box.w + y * box.z + x];
      if (share == 0.0f) continue;
      const __global float *p = image + AT(box.y + y + margin, box.x + x + margin, stride);
      float weight = share / p[3 * (size_t)plane];
      line.x += weight * p[0];
      line.y += weight * p[plane];
      line.z += weight * p[2 * (size_t)plane];
    }
#if TEAM == 1
    sum += line;
#else
    lines[TEAM_RANK] = line;
    barrier(CLK_LOCAL_MEM_FENCE);
    for (int k = 0; k < TEAM && first + k < rows; k++) sum += lines[k];
    barrier(CLK_LOCAL_MEM_FENCE);
#endif
  }
  if (TEAM_RANK == 0) sums[i] = sum;
}
