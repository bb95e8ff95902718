// Items that work on one thing together: one on a CPU, a warp on a GPU. Kernels say what item TEAM_RANK of TEAM does and
// meet at TEAM_SYNC. What they add up is whole numbers or stands in a fixed order, so the bits are the same.
// The host starts them with `team=True` (device.py, Program), on the first axis.
#if LANES > 1
#define TEAM 1
#define TEAM_RANK 0
#define TEAM_SYNC(fence)
#else
#define TEAM 32   // device.py, TEAM
#define TEAM_RANK ((int)get_local_id(0))
#define TEAM_SYNC(fence) barrier(fence)
#endif
// Functions in which a team meets: PoCL 3.0 writes beyond arrays where barriers stay in a function that is called.
#define MEETING __attribute__((always_inline)) static inline
#define TEAM_NUMBER ((int)(get_global_id(0) / TEAM))

// What the items have, added up; all of them are told.
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
  barrier(CLK_LOCAL_MEM_FENCE);   // before it is written again
  return value;
}
#endif
