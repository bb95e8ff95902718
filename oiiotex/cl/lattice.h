// Offset penalty: the cost of a match that is out of phase with the photo's lattice (regularity/offset_prices.py).
// Phases are fractions of a cycle in 32 bits, which wrap by overflow.
#define PHASE_BITS 6

// The offset between target patch (x, y) and exemplar patch (ex, ey), in cycles of u and v, plus half a bin.
// `phases`: of u and v per pixel of the exemplar along x and y, then of the target, then at the corner of both.
static inline uint2 cycles_of_offset(__constant uint *phases, int x, int y, int ex, int ey) {
  uint u = phases[0] * (uint)ex + phases[1] * (uint)ey - phases[4] * (uint)x - phases[5] * (uint)y + phases[8];
  uint v = phases[2] * (uint)ex + phases[3] * (uint)ey - phases[6] * (uint)x - phases[7] * (uint)y + phases[9];
  return (uint2)(u, v);
}

// The penalty, from a table over both phases.
static inline int price_of_offset(__constant uint *phases, const __global int *table, int x, int y, int ex, int ey) {
  uint2 at = cycles_of_offset(phases, x, y, ex, ey);
  return table[at.y >> (32 - PHASE_BITS) << PHASE_BITS | at.x >> (32 - PHASE_BITS)];
}

// The same with phases along one axis from the table: penalties of differences, then phases of the exemplar's
// rows (or columns), then of the target's. `phases`: 1 for rows, the start of the exemplar's, the start of the target's.
static inline int price_of_courses(__constant uint *phases, const __global int *table, int x, int y, int ex, int ey) {
  uint own = (uint)table[phases[1] + (uint)(phases[0] ? ey : ex)];
  uint wanted = (uint)table[phases[2] + (uint)(phases[0] ? y : x)];
  return table[(own - wanted) >> (32 - PHASE_BITS)];
}

// Phase difference of two rows (or columns), in cycles / 2^32, with arguments as in price_of_courses.
static inline int phase_of_courses(__constant uint *phases, const __global int *table, int x, int y, int ex, int ey) {
  uint own = (uint)table[phases[1] + (uint)(phases[0] ? ey : ex)];
  uint wanted = (uint)table[phases[2] + (uint)(phases[0] ? y : x)];
  return (int)(own - wanted - (1u << (31 - PHASE_BITS)));
}

// Phase difference in either direction, in cycles / 2^32.
static inline int2 phases_of_offset(__constant uint *phases, int x, int y, int ex, int ey) {
  uint2 at = cycles_of_offset(phases, x, y, ex, ey);
  return (int2)((int)(at.x - (1u << (31 - PHASE_BITS))), (int)(at.y - (1u << (31 - PHASE_BITS))));
}
