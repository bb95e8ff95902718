# SPDX-License-Identifier: Apache-2.0
"""A drawing of an exemplar graph: exemplars in columns by octaves, edges as arrows labeled with r."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import NamedTuple

from ...engine.deferred import np
from ...synthesis.multiscale.graph import Edge
from .drawing import TEXT, Sheet

_ACROSS, _DOWN, _MARGIN = 72, 56, 24  # px between exemplars, and margin
_LOOP = 22  # px: size of the loop from an exemplar to itself
_HEAD = 9  # px; of an arrow
_APART = 7  # px between the two edges of a pair
_DARK, _ROOT = (0.25, 0.25, 0.25), (0.8, 0.3, 0.1)


class Node(NamedTuple):
    """An exemplar: its name, its octaves below the root, its picture (side, side, 3) in sRGB."""

    name: str
    octave: int
    picture: np.ndarray


def drawn_graph(nodes: Sequence[Node], edges: Sequence[Edge], root: int) -> np.ndarray:
    """(height, width, 3) in sRGB."""
    side = nodes[0].picture.shape[0]
    places = _places(nodes, side)
    width = max(x for x, _ in places) + side + _MARGIN + _LOOP
    height = max(y for _, y in places) + side + TEXT + _MARGIN
    texts = [(_fitting(n.name, side), x, y + side + TEXT) for n, (x, y) in zip(nodes, places, strict=True)]
    texts += [(f"+{n.octave} oct", x, y + side + 2 * TEXT) for n, (x, y) in zip(nodes, places, strict=True)]
    sheet = Sheet(width, height + TEXT)
    for edge in edges:
        line, label = _route(places[edge.source], places[edge.destination], side)
        _draw(sheet, line)
        texts.append((f"r={edge.r}", *label))
    for n, (node, (x, y)) in enumerate(zip(nodes, places, strict=True)):
        sheet.box(x - 2, y - 2, x + side + 1, y + side + 1, _ROOT if n == root else _DARK)
        sheet.paste(node.picture, x, y)
    for text in texts:
        sheet.text(*text)
    return sheet.image()


def _places(nodes: Sequence[Node], side: int) -> list[tuple[int, int]]:
    """The top left corner of every exemplar."""
    octaves = sorted({node.octave for node in nodes})
    rows: dict[int, int] = {}
    corners = []
    for node in nodes:
        row = rows[node.octave] = rows.get(node.octave, -1) + 1
        x = _MARGIN + octaves.index(node.octave) * (side + _ACROSS)
        corners.append((x, _MARGIN + _LOOP + row * (side + _DOWN + 2 * TEXT)))
    return corners


def _fitting(name: str, side: int) -> str:
    """A name, shortened to fit below an exemplar."""
    most = max(4, (side + _ACROSS // 2) // 8)
    return name if len(name) <= most else f"{name[: most - 3]}..."


def _route(
    source: tuple[int, int], destination: tuple[int, int], side: int
) -> tuple[list[tuple[float, float]], tuple[int, int]]:
    """The vertices of an edge's line, and the place of its label."""
    x, y = source
    if source == destination:
        right, top = x + side * 0.8, y - _LOOP
        return [(x + side * 0.2, y - 2), (x + side * 0.2, top), (right, top), (right, y - 2)], (x + side // 3, top - 4)
    (ax, ay), (bx, by) = ((px + side / 2, py + side / 2) for px, py in (source, destination))
    length = math.hypot(bx - ax, by - ay)
    dx, dy = (bx - ax) / length, (by - ay) / length
    out = side / 2 / max(abs(dx), abs(dy)) + 3  # from the middle to the border
    begin = (ax + dx * out - dy * _APART, ay + dy * out + dx * _APART)
    end = (bx - dx * out - dy * _APART, by - dy * out + dx * _APART)
    # offset to one side: the opposite edge has its label on the other
    middle = (begin[0] + end[0]) / 2 - dy * 18, (begin[1] + end[1]) / 2 + dx * 12
    return [begin, end], (round(middle[0]) - 10, round(middle[1]) + 5)


def _draw(sheet: Sheet, line: list[tuple[float, float]]) -> None:
    """Draw a line that ends in an arrow, two pixels wide."""
    (ax, ay), (bx, by) = line[-2:]
    way = math.atan2(by - ay, bx - ax)
    wings = [(bx - _HEAD * math.cos(way + t), by - _HEAD * math.sin(way + t)) for t in (0.45, -0.45)]
    for begin, end in (*itertools.pairwise(line), *((line[-1], wing) for wing in wings)):
        for x, y in ((0, 0), (1, 0), (0, 1)):
            left, top, right, bottom = (round(v) + o for v, o in zip((*begin, *end), (x, y, x, y), strict=True))
            sheet.line(left, top, right, bottom, _DARK)
