// Teams of cooperating items: one item on a CPU, a warp on a GPU. Kernels define the work of item TEAM_RANK of TEAM, and
// synchronize at TEAM_SYNC. Sums are over integers or in a fixed order, so the bits are the same.
// The host starts teams with `team=True` (device.py, Program), on the first axis.
#if LANES > 1
#define TEAM 1
#define TEAM_RANK 0
#define TEAM_SYNC(fence)
#else
#define TEAM 32   // device.py, TEAM
#define TEAM_RANK ((int)get_local_id(0))
#define TEAM_SYNC(fence) barrier(fence)
#endif
// For functions with barriers, which must be inlined: otherwise PoCL 3.0 writes beyond arrays.
#define MEETING __attribute__((always_inline)) static inline
#define TEAM_NUMBER ((int)(get_global_id(0) / TEAM))

// The sum over the items, returned to all.
#if LANES > 1
#define TEAM_SHARED(name)
#define team_total(value, shared) (value)
#else
#define TEAM_SHARED(name) __local long name[TEAM]
MEETING long team_total(long value, __local long *shared) {
  shared[TEAM_RANK] = value;
  for (int apart = TEAM / 2; apart > 0; apart /= 2) {
    barrier(CLK_LOCAL_MEM_FENCE);
    if (TEAM_RANK < apart) shared[TEAM_RANK] += shared[TEAM_RANK + apart];
  }
  barrier(CLK_LOCAL_MEM_FENCE);
  value = shared[0];
  barrier(CLK_LOCAL_MEM_FENCE);   // before the next write
  return value;
}
#endif
