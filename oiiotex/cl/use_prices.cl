// Reuse penalties of exemplar patches, for content that the field uses too often: repeated regions, and the flat parts of
// the exemplar, which mean votes favor (patchmatch/use_prices.py).
// All sums and penalties are integers: decisions do not depend on the order of work.
#include "offsets.h"

#define MOST 500000000   // of each penalty: two of them and one of patchmatch.cl stay below INT_MAX together

// The start of the region around patch `at` of `n`, shifted inside at the borders.
static inline int first_of_region(int at, int side, int n) {
  int first = at - side / 2, last = n > side ? n - side : 0;
  return first < 0 ? 0 : first > last ? last : first;
}

// Field patches of each kind of exemplar patch, whose rows `e_from` to `e_to` are held.
__kernel void use_prices_count(const __global uint *restrict field, const __global uchar *restrict kinds,
                               __global int *restrict counts, int columns, int rows, int e_columns, int e_from, int e_to) {
  int x = get_global_id(0), y = get_global_id(1);
  if (x >= columns || y >= rows) return;
  uint at = field[AT(y, x, columns)];
  if (corner_y(at) < e_from || corner_y(at) >= e_to) return;
  atomic_inc(counts + kinds[AT(corner_y(at) - e_from, corner_x(at), e_columns)]);
}

// One step of dual ascent for the constraints 'at most most[k] patches of kinds 0 to k': the penalty of a constraint
// rises by `step` times the fraction of excess patches, or falls by that of the remaining ones. A step grows while its
// direction (its sign) is the same and is halved when it turns, between `least` and `greatest`, because fields react to
// penalties at once or hardly at all. A kind pays for all constraints that it belongs to.
__kernel void use_prices_ascend(const __global int *restrict counts, const __global int *restrict most,
                                __global int *restrict duals, __global int *restrict steps, __global int *restrict prices,
                                int kinds, int patches, int least, int greatest) {
  if (get_global_id(0) > 0) return;
  long below = 0, total = 0;
  for (int k = 0; k < kinds; k++) {
    below += counts[k];
    long over = below - most[k];
    int step = abs(steps[k]);
    step = (over < 0) == (steps[k] < 0) ? step + step / 4 : step / 2;
    step = step < least ? least : step > greatest ? greatest : step;
    steps[k] = over < 0 ? -step : step;
    long dual = duals[k] + step * over / patches;
    duals[k] = dual < 0 ? 0 : dual > MOST ? MOST : (int)dual;
  }
  for (int k = kinds - 1; k >= 0; k--) {
    total += duals[k];
    prices[k] = total > MOST ? MOST : (int)total;
  }
}

// Uses in the region around each exemplar patch, over a given number of rows: along rows here,
__kernel void use_prices_rows(const __global int *restrict count, __global int *restrict sums, int e_columns, int counted, int side) {
  int x = get_global_id(0), y = get_global_id(1);
  if (x >= e_columns || y >= counted) return;
  int first = first_of_region(x, side, e_columns), sum = 0;
  for (int i = first; i < first + side && i < e_columns; i++) sum += count[AT(y, i, e_columns)];
  sums[AT(y, x, e_columns)] = sum;
}
// and along columns here, where uses above `most` become a quadratic penalty, which is added with that of the patch's kind
// for rows `e_from` to `e_to`. `c_from` is the first counted row.
__kernel void use_prices_add(const __global int *restrict sums, const __global uchar *restrict kinds,
                             const __global int *restrict prices, __global int *restrict penalty,
                             int e_columns, int e_rows, int e_from, int e_to, int c_from, int side, int most, int unit) {
  int x = get_global_id(0), y = e_from + get_global_id(1);
  size_t p = AT(y - e_from, x, e_columns);
  if (x >= e_columns || y >= e_to || penalty[p] == INT_MAX) return;
  int first = first_of_region(y, side, e_rows);
  long uses = 0;
  for (int i = first; i < first + side && i < e_rows; i++) uses += sums[AT(i - c_from, x, e_columns)];
  long over = uses > most ? 16 * (uses - most) / (side * side) : 0;
  long price = over < 65536 ? over * over * unit / 256 : MOST;
  penalty[p] += (int)(price < MOST ? price : MOST) + prices[kinds[p]];
}
