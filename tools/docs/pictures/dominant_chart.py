# SPDX-License-Identifier: Apache-2.0
"""Plots of how a dominant texture was found: LDR09 figures 3 and 4."""

from __future__ import annotations

import numpy as np

from oiiotex.analysis.dominant.diffusion import Dominance
from oiiotex.surfaces.charts.drawing import INK, PAPER, TEXT, Sheet

COLORS = ((0.10, 0.45, 0.85), (0.85, 0.35, 0.05), (0.55, 0.35, 0.65), (0.55, 0.55, 0.55))  # types 0 to III
WIDTH, HEIGHT = 400, 320  # px of a panel
_MARGIN, _TOP = 44, 40
_LINE = (0.75, 0.05, 0.15)
_DECADES = 12.0  # of heat and density, down from the maximum
_NAMES = ("dominant", "small group", "bridge", "scattered")


class Plot:
    """A frame with a linear scale in each direction."""

    def __init__(self, x: np.ndarray, y: np.ndarray):
        self.pixels = np.full((HEIGHT, WIDTH, 3), PAPER)
        self.texts: list[tuple[str, int, int]] = []
        self._x, self._y = _limits(x), _limits(y)
        left, right, top, bottom = _MARGIN, WIDTH - 12, _TOP, HEIGHT - _MARGIN
        for row in (top, bottom):
            self.pixels[row, left : right + 1] = INK
        for column in (left, right):
            self.pixels[top : bottom + 1, column] = INK
        for value, column in ((self._x[0], left), (self._x[1], right - 34)):
            self.texts.append((f"{value:.1f}", column, bottom + TEXT))
        for value, row in ((self._y[0], bottom), (self._y[1], top + 10)):
            self.texts.append((f"{value:.1f}", 4, row))

    def place(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Rows and columns of points, clipped to the frame."""
        across = (np.asarray(x) - self._x[0]) / (self._x[1] - self._x[0])
        up = (np.asarray(y) - self._y[0]) / (self._y[1] - self._y[0])
        column = _MARGIN + 1 + np.rint(np.clip(across, 0, 1) * (WIDTH - 15 - _MARGIN)).astype(np.int64)
        row = HEIGHT - _MARGIN - 1 - np.rint(np.clip(up, 0, 1) * (HEIGHT - _MARGIN - _TOP - 2)).astype(np.int64)
        return row, column

    def upright(self, x: float) -> None:
        """Draw a vertical line at x."""
        _, column = self.place(np.array(x), np.array(self._y[0]))
        self.pixels[_TOP : HEIGHT - _MARGIN : 2, column] = _LINE

    def level(self, y: float) -> None:
        """Draw a horizontal line at y."""
        row, _ = self.place(np.array(self._x[0]), np.array(y))
        self.pixels[row, _MARGIN : WIDTH - 12 : 2] = _LINE

    def drawn(self) -> np.ndarray:
        """(HEIGHT, WIDTH, 3), sRGB 0 .. 1."""
        sheet = Sheet(WIDTH, HEIGHT)
        sheet.paste(self.pixels, 0, 0)
        for text in self.texts:
            sheet.text(*text)
        return sheet.image()


def _limits(values: np.ndarray) -> tuple[float, float]:
    low, high = (float(values.min()), float(values.max())) if len(values) else (0.0, 1.0)
    return (low, high) if high > low else (low - 0.5, low + 0.5)


def curve_panel(texture: Dominance) -> Plot:
    """Figure 3: log of the sum of weights over log epsilon, with its steepest point and slope."""
    kernel = texture.kernel
    curve = kernel.curve if kernel else np.zeros((0, 2))
    panel = Plot(*curve.T)
    panel.texts.append(("log sum of weights over log epsilon", _MARGIN, TEXT))
    if kernel is None:
        panel.texts.append(("all texels are equal: no curve", _MARGIN, 2 * TEXT + 4))
        return panel
    dense = np.linspace(curve[0, 0], curve[-1, 0], 4 * WIDTH)
    panel.pixels[panel.place(dense, np.interp(dense, *curve.T))] = INK
    at = np.log(kernel.landmark_size)
    panel.upright(float(at))
    near = dense[np.abs(dense - at) < 1.5]
    tangent = np.interp(at, *curve.T) + kernel.dimension / 2 * (near - at)  # eq. 2
    inside = (tangent > curve[:, 1].min()) & (tangent < curve[:, 1].max())
    panel.pixels[panel.place(near[inside], tangent[inside])] = _LINE
    panel.texts.append((f"epsilon' {kernel.landmark_size:.3g}, d = {kernel.dimension:.1f}", _MARGIN, 2 * TEXT + 4))
    return panel


def heat_panel(texture: Dominance) -> Plot:
    """Figure 4: log density over log heat in the last round, by type, with that round's thresholds."""
    heat = np.maximum(texture.heat, texture.heat.max(initial=-300.0) - _DECADES)
    density = np.log10(np.maximum(texture.density, 1e-9))
    density = np.maximum(density, density.max(initial=-9.0) - _DECADES)
    panel = Plot(heat, density)
    panel.texts.append(("log10 density over log10 heat", _MARGIN, TEXT))
    row, column = panel.place(heat, density)
    for kind in (3, 2, 1, 0):
        here = texture.types == kind
        panel.pixels[row[here], column[here]] = COLORS[kind]
    left = _MARGIN
    for kind, name in enumerate(_NAMES):
        panel.pixels[_TOP - 14 : _TOP - 6, left : left + 8] = COLORS[kind]
        panel.texts.append((name, left + 12, _TOP - 6))
        left += 92
    if texture.rounds:
        last = texture.rounds[-1]
        if last.heat is not None:
            panel.upright(last.heat)
        if np.isfinite(last.density) and last.density > 0:
            panel.level(float(np.log10(last.density)))
    return panel


def diagnostics(texture: Dominance) -> np.ndarray:
    """Both figures side by side, (HEIGHT, 2 WIDTH, 3), sRGB 0 .. 1."""
    return np.concatenate([curve_panel(texture).drawn(), heat_panel(texture).drawn()], axis=1)
