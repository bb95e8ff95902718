// A regular grid of cells over an image, shared by kernels for local statistics: stationarity/grid_statistics.py,
// CellGrid. Include it with FP_CONTRACT off.
#include "offsets.h"

// Sizes of the image and the grid along x and y, and the axes along which the image wraps.
#define GRID_ARGS int width, int height, int cells_x, int cells_y, int wrap_x, int wrap_y
#define GRID width, height, cells_x, cells_y, wrap_x, wrap_y

// C's conversion rounds towards zero; this is floor() without the call that some CPU runtimes do not inline.
static inline int floor_int(float v) { int i = (int)v; return i - (v < (float)i); }

// Buffers hold rows of the image from `first` on and rows of cells from `first_cells` on, counted beyond the border if
// they wrap; 0 if a buffer holds all. `held_cells` is the number of rows of cells per channel.
#define HELD_ARGS int first, int first_cells, int held_cells

// Index of the statistics of a channel's cell: [channel][cell y][cell x].
#define CELL(c, cy, cx) (((size_t)(c) * held_cells + (cy)) * cells_x + (cx))
// Row y of the image within the held rows.
#define HELD(y) WRAPPED((y) - first, height)

// Each pixel is distributed bilinearly to the four cells around it: along each axis, a cell gathers pixels less than one
// pitch from its center, weighted by a tent function.
typedef struct { float pitch, center; int first; } tent;
static inline tent tent_of(int cell, int size, int cells) {
  float pitch = (float)size / (float)cells, center = ((float)cell + 0.5f) * pitch - 0.5f;
  tent t = {pitch, center, floor_int(center - pitch) + 1};
  return t;
}
static inline int tent_covers(tent t, int at) { return (float)at < t.center + t.pitch; }
static inline float tent_at(tent t, int at) {
  float away = (float)at < t.center ? t.center - (float)at : (float)at - t.center;
  return 1.0f - away / t.pitch;
}

// Whether there is a pixel (or a cell) at or beyond the border.
#define THERE(i, n, wrap) ((wrap) || ((i) >= 0 && (i) < (n)))

// The four cells around a pixel: their indices within a channel's held cells, and their weights, 0 for missing cells.
// Returns the sum of the weights.
static inline float cells_around(int x, int y, GRID_ARGS, int first_cells, size_t *cell, float *weight) {
  float gx = ((float)x + 0.5f) * ((float)cells_x / (float)width) - 0.5f;
  float gy = ((float)y + 0.5f) * ((float)cells_y / (float)height) - 0.5f;
  int x0 = floor_int(gx), y0 = floor_int(gy);
  float right = gx - (float)x0, lower = gy - (float)y0, weights = 0.0f;
  for (int k = 0; k < 4; k++) {
    int cx = x0 + (k & 1), cy = y0 + (k >> 1), there = THERE(cx, cells_x, wrap_x) && THERE(cy, cells_y, wrap_y);
    cell[k] = there ? AT(WRAPPED(WRAPPED(cy, cells_y) - first_cells, cells_y), WRAPPED(cx, cells_x), cells_x) : 0;
    weight[k] = there ? ((k & 1) ? right : 1.0f - right) * ((k >> 1) ? lower : 1.0f - lower) : 0.0f;
    weights += weight[k];
  }
  return weights;
}
