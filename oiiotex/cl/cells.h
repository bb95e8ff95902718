// A grid of cells over an image, shared by what keeps local statistics on one.
#ifndef CHANNELS
#define CHANNELS 3   // values of a pixel; each has statistics of its own
#endif

// C's conversion rounds towards zero; this is floor() without the call that some CPU runtimes do not inline.
inline int floor_int(float v) { int i = (int)v; return i - (v < (float)i); }

// Index of a cell at or beyond the border: wrapped, or -1 where there is none.
inline int cell_at(int i, int n, int wrap) {
  return i >= 0 && i < n ? i : !wrap ? -1 : i < 0 ? i + n : i - n;
}
