// Counter-based random numbers: a hash of (seed, step, absolute coordinates), never a state.
// PCG output permutation, O'Neill 2014; chained as in Jarzynski & Olano, JCGT 9(3), 2020.
static inline uint hash_pcg(uint v) {
  uint state = v * 747796405u + 2891336453u;
  uint word = ((state >> ((state >> 28) + 4u)) ^ state) * 277803737u;
  return (word >> 22) ^ word;
}

static inline uint hash_at(uint seed, uint step, int y, int x) {
  return hash_pcg((uint)x + hash_pcg((uint)y + hash_pcg(step + hash_pcg(seed))));
}

// Maps 32 random bits to 0 .. n-1 without a modulo's bias or cost.
static inline int hash_below(uint bits, int n) { return (int)(((ulong)bits * (ulong)(uint)n) >> 32); }
