# SPDX-License-Identifier: Apache-2.0
"""Modifiers over all filters: one name has one meaning and one type."""

from __future__ import annotations

import ast
from collections import defaultdict
from pathlib import Path

import pytest

from oiiotex.engine.core.parameters import Parameter, Size, SizeRule, Words
from oiiotex.filters import OURS
from tools.modifiers import inputs_and_modifiers

# inputs that are photos, masks or ids: an image that is the field of a quantity is named QUANTITYmap
PICTURES = {
    "exemplar", "source", "photos", "shares", "plate", "tile", "maps", "materials",
    "mask", "region", "guide", "painting", "fine", "donor",
}  # fmt: skip
# outputs that come along with another, or cannot have the modifier's name: `label` is the id of a label
ALONG = {
    ("fit.N", "membership"), ("transfer.N", "st"), ("transfer", "st"), ("exemplar.N", "graphfile"),
    ("label.N", "labelmaps"),
}  # fmt: skip


def type_of(parameter: Parameter) -> str:
    """What a user writes for it."""
    kinds = set(parameter.kind or ())
    if parameter.kind is None:
        return "image"
    if kinds & {Size, SizeRule}:
        return "size"
    if bool in kinds and Path in kinds:
        return "flag or file"
    if bool in kinds:
        return "flag"  # some have values between no and yes, or several kinds of yes
    return "number" if kinds & {int, float} else "words" if Words in kinds else " or ".join(sorted(map(str, kinds)))


def test_a_name_has_one_type_in_all_filters():
    types: dict[str, dict[str, list[str]]] = defaultdict(lambda: defaultdict(list))
    for op in OURS:
        for parameter in inputs_and_modifiers(op):
            types[parameter.name][type_of(parameter)].append(op.name)
    assert {name: dict(found) for name, found in types.items() if len(found) > 1} == {}


def test_a_modifier_for_an_output_has_its_name():
    asking = {(o.name, o.asked_by) for op in OURS for o in op.outputs if o.asked_by and not o.instead}
    assert {(output, name) for output, name in asking if output.removesuffix(".N") != name} <= ALONG


def test_what_is_written_is_not_read():
    written = {o.asked_by for op in OURS for o in op.outputs if o.asked_by}
    read = {p.name for op in OURS for p in inputs_and_modifiers(op) if p.name not in {o.asked_by for o in op.outputs}}
    assert written & read == set()


def test_images_of_a_quantity_end_in_map_and_nothing_else_does():
    for op in OURS:
        for parameter in inputs_and_modifiers(op):
            is_field = parameter.kind is None and parameter.name not in PICTURES
            assert parameter.name.endswith("map") == is_field, f"{op.name}: {parameter.name}"


@pytest.mark.parametrize("name", ["sigma", "patch", "panel", "size", "seamzone", "fade"])
def test_lengths_are_in_pixels(name):
    units = {p.unit for op in OURS for p in op.modifiers() if p.name == name}
    assert units == {"px"}


def test_errors_name_declared_modifiers():
    """A user who reads `--op: NAME=value: expected ...` finds the modifier of that name."""
    names = {parameter.name for op in OURS for parameter in inputs_and_modifiers(op)}
    named: dict[str, set[str]] = {}
    root = Path(__file__).parents[2] / "oiiotex"
    for path in (path for path in root.rglob("*.py") if "oiiotool" not in path.parts):  # host ops have other names
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.keyword) and node.arg == "parameter" and isinstance(node.value, ast.Constant):
                named.setdefault(node.value.value, set()).add(path.name)
    assert {name: places for name, places in named.items() if name not in names} == {}
