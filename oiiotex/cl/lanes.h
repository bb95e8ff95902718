// One source for CPUs with wide registers and for GPUs. LANES is the number of 16-bit lanes in a register:
// 32 (AVX-512), 16 (AVX2, NEON) or 1 (GPUs, where each work-item is a lane).
// All sums below are over integers, so all widths give the same bits.
#ifndef LANES
#define LANES 1
#endif

#if LANES > 1
typedef short lane_s8 __attribute__((ext_vector_type(8), aligned(2)));
typedef short lane_s16 __attribute__((ext_vector_type(16), aligned(2)));
typedef int lane_i4 __attribute__((ext_vector_type(4)));
typedef int lane_i8 __attribute__((ext_vector_type(8)));
// Squares of adjacent 16-bit pairs added into 32 bits: this shape compiles to one multiply-add.
static inline lane_i4 squares8(lane_s8 d) {
  lane_i4 even = __builtin_convertvector(d.even, lane_i4), odd = __builtin_convertvector(d.odd, lane_i4);
  return even * even + odd * odd;
}
static inline lane_i8 squares16(lane_s16 d) {
  lane_i8 even = __builtin_convertvector(d.even, lane_i8), odd = __builtin_convertvector(d.odd, lane_i8);
  return even * even + odd * odd;
}
static inline int total4(lane_i4 v) { v.xy += v.zw; return v.x + v.y; }
static inline int total8(lane_i8 v) { return total4(v.lo + v.hi); }
#endif

#if LANES > 16
typedef short lane_s32 __attribute__((ext_vector_type(32), aligned(2)));
typedef int lane_i16 __attribute__((ext_vector_type(16)));
static inline lane_i16 squares32(lane_s32 d) {
  lane_i16 even = __builtin_convertvector(d.even, lane_i16), odd = __builtin_convertvector(d.odd, lane_i16);
  return even * even + odd * odd;
}
static inline int total16(lane_i16 v) { return total8(v.lo + v.hi); }
#endif
