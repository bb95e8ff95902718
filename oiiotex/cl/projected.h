// Neighborhoods of 5 x 5 pixels projected to DIMS dimensions: DIMS 16-bit integers within +- 5790, so that a squared
// distance fits 31 bits (16 (2 * 5790)^2 < 2^31). All sums are over integers: every number of lanes gives the same bits.
#include "lanes.h"
#define DIMS 16
#define MOST_PROJECTED 5790

// On a CPU an item processes RUN pixels at once, to hide memory latency: it first prefetches the data of all of them.
// On a GPU other items run meanwhile; RUN is 1.
#if defined(__x86_64__) && RUN > 1
#define PREFETCH(at) __builtin_prefetch((const void *)(size_t)(at))
#else
#define PREFETCH(at)
#endif

#if LANES > 1
typedef lane_s16 projected;
static inline projected projected_at(const __global short *from) { return *(const __global lane_s16 *)from; }
static inline uint projected_distance(projected a, const __global short *b) {
  return (uint)total8(squares16(a - *(const __global lane_s16 *)b));
}
#else
typedef short16 projected;   // 32 bytes, aligned to that: two loads
static inline projected projected_at(const __global short *from) { return *(const __global short16 *)from; }
static inline uint projected_distance(projected a, const __global short *b) {
  int16 d = convert_int16(a) - convert_int16(projected_at(b));
  d *= d;
  int8 s8 = d.lo + d.hi;
  int4 s4 = s8.lo + s8.hi;
  return (uint)(s4.x + s4.y + s4.z + s4.w);
}
#endif

// A texel is named by (level << 2 side) + (y << side) + x, `side` being log2 of the exemplars' side.
#define TEXEL_X(texel, side) ((int)((texel) & ((1u << (side)) - 1u)))
#define TEXEL_Y(texel, side) ((int)(((texel) >> (side)) & ((1u << (side)) - 1u)))
#define TEXEL_LEVEL(texel, side) ((int)((texel) >> (2 * (side))))
static inline uint texel_at(int level, int y, int x, int side) {   // coordinates wrap: exemplars are periodic
  uint inside = (1u << side) - 1u;
  return ((uint)level << (2 * side)) | (((uint)y & inside) << side) | ((uint)x & inside);
}
