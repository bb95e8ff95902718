# SPDX-License-Identifier: Apache-2.0
"""Nodes of MaterialX graphs, and the plane of `hexagons` in standard nodes, which every language of MaterialX has."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from oiiotex.engine.deferred import np

from .hexagons import EXPONENT, GRID, STREAM, HexMap


def node_of(graph: Any, category: str, name: str, kind: str, inputs: Mapping[str, Any]) -> Any:
    """A new node with connected inputs."""
    node = graph.addNode(category, name, kind)
    for input_name, source in inputs.items():
        node.addInput(input_name, source.getType()).setConnectedNode(source)
    return node


class Hexagons:
    """The three hexagons at a shading point: weights and texture coordinates, as `hexagons` has them.

    Parameters
    ----------
    graph : NodeGraph
    tile_m : (float, float)
        Width and height of a tile in units of texture coordinates.
    """

    def __init__(self, graph: Any, tile_m: tuple[float, float]):
        self._graph, self._count = graph, 0
        uv = graph.addNode("texcoord", "hex_uv", "vector2")
        place = self._of("multiply", "vector2", uv, (1 / tile_m[0], -1 / tile_m[1]))  # v downwards, as in images
        skewed = [
            self._of("dotproduct", "float", place, axis)
            for axis in ((GRID, -GRID / math.sqrt(3)), (0.0, 2 * GRID / math.sqrt(3)))
        ]
        base = [self._node("floor", "float", **{"in": at}) for at in skewed]
        x, y = (self._of("subtract", "float", *pair) for pair in zip(skewed, base, strict=True))
        total = self._of("add", "float", x, y)
        upper = self._greater(total, 1.0, 1.0, 0.0)
        rest = [self._of("subtract", "float", 1.0, one) for one in (total, y, x)]
        weights = (
            self._node("absval", "float", **{"in": rest[0]}),
            self._greater(total, 1.0, rest[1], x), self._greater(total, 1.0, rest[2], y),
        )  # fmt: skip
        color = self._of("subtract", "float", *base)
        self._weights, self._places = [], []
        for slot in range(3):
            # 1/6, 3/6 or 5/6 of a turn, so that rounding changes nothing
            third = self._of("multiply", "float", self._of("subtract", "float", slot + 0.5, color), 1 / 3)
            turn = self._of("subtract", "float", third, self._node("floor", "float", **{"in": third}))
            name = self._node(
                "combine2", "vector2",
                in1=self._of("add", "float", base[0], self._chosen(turn, upper, 1.0, 0.0)),
                in2=self._of("add", "float", base[1], self._chosen(turn, upper, 0.0, 1.0)),
            )  # fmt: skip
            self._weights.append(self._of("power", "float", self._chosen(turn, *weights), float(EXPONENT)))
            self._places.append(self._place(place, name))
        every = self._node("combine3", "vector3", in1=self._weights[0], in2=self._weights[1], in3=self._weights[2])
        self._total = self._of("dotproduct", "float", every, (1.0, 1.0, 1.0))
        self._norm = self._node("sqrt", "float", **{"in": self._of("dotproduct", "float", every, every)})

    def mean(self, role: str, file: str, kind: str) -> Any:
        """The weighted mean of a map."""
        return self._of("divide", kind, self._sum(role, file, kind), self._total)

    def blended(self, role: str, file: str, tile: HexMap) -> Any:
        """A map of one channel or three, with its histogram: a node of type float or vector3."""
        kind = "float" if tile.table.shape[1] == 1 else "vector3"
        off = self._of("multiply", "float", self._total, 0.5)
        gaussian = self._of("divide", kind, self._of("subtract", kind, self._sum(role, file, kind), off), self._norm)
        gaussian = self._of("add", kind, gaussian, 0.5)
        knots, parts = len(tile.table) - 1, tile.table[1:] - tile.table[:-1]
        value = tile.table[0] - (parts * np.arange(knots)[:, None]).sum(0)
        for n, slope in enumerate(parts * knots):
            piece = self._node("clamp", kind, **{"in": gaussian, "low": n / knots, "high": (n + 1) / knots})
            value = self._of("add", kind, self._of("multiply", kind, piece, slope), value)
        if kind == "float":
            return self._of("multiply", kind, value, float(tile.axes[0, 0]))
        channels = [self._of("dotproduct", "float", value, axis) for axis in tile.axes.T]
        return self._node("combine3", kind, in1=channels[0], in2=channels[1], in3=channels[2])

    def _sum(self, role: str, file: str, kind: str) -> Any:
        total = None
        for slot, (weight, place) in enumerate(zip(self._weights, self._places, strict=True)):
            image = self._graph.addNode("image", f"{role}_image{slot or ''}", kind)
            image.addInput("texcoord", "vector2").setConnectedNode(place)
            source = image.addInput("file", "filename")
            source.setValueString(file)
            source.setColorSpace("none")
            piece = self._of("multiply", kind, image, weight)
            total = piece if total is None else self._of("add", kind, total, piece)
        return total

    def _place(self, place: Any, name: Any) -> Any:
        """Where a hexagon reads the tile, v upwards."""
        noises = []
        for across in (0.5, STREAM + 0.5):  # inside cells, so that rounding changes nothing
            noises.append(self._node("cellnoise2d", "float", texcoord=self._of("add", "vector2", name, (0.5, across))))
        axes = (1 / GRID, 0.5 / GRID), (0.0, math.sqrt(3) / 2 / GRID)
        center = [self._of("dotproduct", "float", name, axis) for axis in axes]
        moved = [self._of("subtract", "float", *pair) for pair in zip(noises, center, strict=True)]
        shift = self._node("combine2", "vector2", in1=moved[0], in2=moved[1])
        return self._of("multiply", "vector2", self._of("add", "vector2", place, shift), (1.0, -1.0))

    def _chosen(self, turn: Any, first: Any, second: Any, third: Any) -> Any:
        """One of three for a turn of 1/6, 3/6 and 5/6."""
        return self._greater(turn, 2 / 3, third, self._greater(turn, 1 / 3, second, first))

    def _greater(self, value: Any, limit: float, high: Any, low: Any) -> Any:
        return self._node("ifgreater", "float", value1=value, value2=limit, in1=high, in2=low)

    def _of(self, category: str, kind: str, first: Any, second: Any) -> Any:
        return self._node(category, kind, in1=first, in2=second)

    def _node(self, category: str, kind: str, **ports: Any) -> Any:
        """A node whose ports are nodes, numbers or vectors."""
        self._count += 1
        node = self._graph.addNode(category, f"hex_{self._count}", kind)
        for name, value in ports.items():
            if hasattr(value, "getType"):
                node.addInput(name, value.getType()).setConnectedNode(value)
            else:
                given = np.ravel(value)
                port = node.addInput(name, "float" if len(given) == 1 else f"vector{len(given)}")
                port.setValueString(", ".join(f"{number:.9g}" for number in given))
        return node
