# SPDX-License-Identifier: Apache-2.0
"""The table of the OpenFX nodes from the filters' declarations: `python -m tools.openfx` writes it.

The plugin (hosts/openfx) knows no filter: it defines the clips and parameters that this table lists.
"""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

from oiiotex.engine.color.config import DEFAULT_CONFIG, ColorConfig
from oiiotex.engine.core.access import AnyWindow
from oiiotex.engine.core.op import Kind, Op, Space
from oiiotex.engine.core.parameters import Numbers, Parameter, Size, Words, declared
from oiiotex.filters import op_named
from oiiotex.oiiotool.cli.printing.report import description, on_a_line

TABLE = Path(__file__).parents[1] / "hosts" / "openfx" / "nodes.json"
NODES = {
    "Tile": "stationarize", "Fill": "fill", "Flatten": "flatten", "Synthesize": "synth", "Quilt": "quilt",
    "Labels": "label", "DominantMask": "dominant", "Height": "estimateheight", "Rectify": "rectify",
    "Preview": "preview",
}  # fmt: skip
# what a node does not have: several images, label parts of its inputs, files, parts of more than four channels, and the
# window, which the host asks for
_WITHOUT = {
    "drift", "fail", "keeplayout", "kinds", "label", "labellevel", "labelmaps", "lod", "mapweights", "matte",
    "membership", "onepart", "pack", "photo", "replace", "resume", "variants", "window",
}  # fmt: skip
_STILL = ("Tile", "Synthesize", "Quilt")  # from one frame of a shot, so that the texture does not change in each frame
_MASKS = ("mask", "region")
# words of a line for a required image whose clip is not connected: what is not opaque in Source is the region
_INSTEAD = {"region": "--dup --ch A --invert --mulc 1000"}
_MOST = (1 << 31) - 1  # parameters of hosts are 32-bit integers


def _of_node(name: str, kind: str, help: str, told: bool = False, **facts: Any) -> dict[str, Any]:
    """A parameter of the node itself, not of its filter; `told`: it changes no pixel."""
    default = {} if kind == "button" else {"default": "" if kind == "string" else 0}
    fixed = {"pixels": False, "auto": False, "least": None, "advanced": False, "host": True, "told": told}
    return {"name": name, "label": name.capitalize(), "type": kind, "help": help} | fixed | default | facts


_FRAME = (
    _of_node("hold", "bool", "Use one frame of the inputs for the whole shot, so that the texture does not change.")
    | {"default": 1},
    _of_node("frame", "int", "Frame of the inputs, with hold. It is clamped to the clip's frame range.")
    | {"min": -_MOST, "max": _MOST, "shown": 1000},
)
_ORIGIN = _of_node("origin", "size", "Place of the result on the unbounded plane: right and down, in pixels.") | {
    "min": -_MOST, "max": _MOST, "shown": 1000,
}  # fmt: skip
_LAST = (
    _of_node("line", "string", "Command line that makes the same pixels from files of the inputs.", told=True),
    _of_node("check", "button", "Judge the result of this frame, and show the verdict.", told=True),
    _of_node("verdict", "string", "Verdict on the result when it was last checked.", told=True),
)


def _first_parameters(outputs: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """The parameters for the output and the color space."""
    space = "Color space of the inputs, or a role of the config. Default: the host's, if it tells one."
    first = []
    if len(outputs) > 1:
        words = " ".join(f"{one['label']}: {one['help']}" for one in outputs)
        first.append(_of_node("output", "choice", words, options=[one["label"] for one in outputs]))
    if outputs[-1]["label"] == "Matte":
        words = "Label whose matte is shown: its level, the finest is 1, and its id. A wrong name lists some."
        first.append(_of_node("matte", "string", words, default="label.1/1"))
    listed = _of_node(
        "spaces",
        "choice",
        "Write a name of the config into colorspace.",
        told=True,
        options=["choose ...", *ColorConfig(DEFAULT_CONFIG).roles_and_spaces()],
    )
    return [*first, _of_node("colorspace", "string", space), listed]


def table() -> dict[str, Any]:
    """The nodes."""
    return {"nodes": [_node(*pair) for pair in NODES.items()]}


def _node(name: str, filter_name: str) -> dict[str, Any]:
    """A node: clips, parameters, outputs, and what a host must know about its windows."""
    op = op_named(filter_name)
    images, parameters = declared(op)
    inputs = [i for i in images if not (i.many or i.advanced)]
    asking = {output.asked_by for output in op.outputs}
    kept = [p for p in parameters if p.name not in _WITHOUT | asking and p.kind != (Path,)]
    clips, outputs, any_window = (
        [_input(n, i, op) for n, i in enumerate(inputs)],
        _outputs(op),
        issubclass(op, AnyWindow),
    )
    simple = sum(not clip["optional"] for clip in clips) == 1
    return {
        "name": name,
        "label": re.sub(r"(?<!^)([A-Z])", lambda letter: f" {letter[0].lower()}", name),
        "op": op.name,
        "help": on_a_line(description(op), op, "'"),
        "contexts": [*["Filter"] * simple, "General", *["Generator"] * any_window],
        "color": op.space is Space.LAB,
        "anywindow": any_window,
        "still": name in _STILL,
        "keepsspace": op.main().kind is Kind.PIXELS,
        "inputs": clips,
        "outputs": outputs,
        "params": [
            *_first_parameters(outputs),
            *(_parameter(p, op) for p in kept if not p.advanced),
            *(_FRAME if name in _STILL else ()),
            *([_ORIGIN] if any_window else ()),
            *_LAST,
            *(_parameter(p, op) for p in kept if p.advanced),
        ],
    }


def _input(number: int, image: Parameter, op: type[Op]) -> dict[str, Any]:
    """A clip; the first is called as OpenFX demands."""
    return {
        "clip": image.name.capitalize() if number else "Source",
        "slot": image.name,
        "optional": not image.required or image.name in _INSTEAD,
        "without": _INSTEAD.get(image.name, ""),
        "mask": image.name in _MASKS,
        "help": on_a_line(image.help, op, "'"),
    }


def _outputs(op: type[Op]) -> list[dict[str, Any]]:
    """The outputs of the node: the op's image, and each part that a parameter requests."""
    shown = [o for o in op.outputs if o.kind.is_image and o.kind is not Kind.PICTURE and not o.of]
    shown = [o for o in shown if o.name != "transfer"]  # only with a graph, which is a file
    shown.sort(key=lambda output: bool(output.asked_by))
    outputs = [
        {
            "label": output.name.removesuffix(".N").capitalize(),
            "part": output.name.removesuffix("N"),
            "ask": output.asked_by,
            "after": f" --subimage {output.name}" if output.asked_by else "",
            "mask": output.kind is Kind.MASK,
            "help": output.help,
        }
        for output in shown
        if not output.asked_by or output.asked_by not in _WITHOUT
    ]
    if op.name == "label":
        matte = {"label": "Matte", "part": "cryptomatte", "ask": "cryptomatte", "mask": True}
        outputs.append(matte | {"after": " --cryptomatte-unfold", "help": "Matte of one label, by its name."})
    return outputs


def _parameter(parameter: Parameter, op: type[Op]) -> dict[str, Any]:
    """A parameter as a host shows it. `auto`: its default value leaves the decision to the filter."""
    kinds = [kind for kind in parameter.kind or () if kind is not Path]
    facts: dict[str, Any] = {
        "name": parameter.name,
        "label": parameter.name.capitalize(),
        "help": on_a_line(parameter.described(parameter.help), op, "'"),
        "advanced": parameter.advanced,
        "pixels": parameter.unit == "px",
        "auto": parameter.default is None,
        "least": parameter.ge,
        "host": False,
        "told": False,
    }
    if parameter.choices:
        words = [_word(choice) for choice in parameter.choices if choice is not None]
        words = (["automatic"] if parameter.default is None else []) + words
        default = 0 if parameter.default is None else words.index(_word(parameter.default))
        return facts | {"type": "choice", "options": words, "default": default}
    if Size in kinds:
        return facts | {"type": "size", "default": 0, "min": 0, "max": int(_bound(parameter.le, _MOST)), "shown": 8192}
    if kinds == [bool]:
        return facts | {"type": "bool", "default": int(bool(parameter.default))}
    if Numbers in kinds or Words in kinds or str in kinds:
        return facts | {"type": "string", "default": str(parameter.default or "")}
    return facts | _number(parameter, int if int in kinds else float)


def _number(parameter: Parameter, kind: type) -> dict[str, Any]:
    """A number. One that the filter decides by default has a value outside its range for that."""
    least = kind(-_MOST if parameter.ge is None else parameter.ge)
    most = kind(_bound(parameter.le, _MOST))
    default = parameter.default
    if default is None:  # 0 or -1 where that is outside of the range
        default = least = kind(0 if (parameter.ge or 0) > 0 else (parameter.ge or 0) - 1)
    shown = most if most <= 1024 else kind(max(100, 2 * default))
    return {"type": kind.__name__, "default": kind(default), "min": least, "max": most, "shown": shown}


def _bound(value: float | None, other: int) -> float:
    return other if value is None else min(value, other)


def _word(choice: Any) -> str:
    """A choice as it is typed on the command line."""
    return str(int(choice)) if isinstance(choice, bool) else str(choice)


def text() -> str:
    """The table as it is committed."""
    return json.dumps(table(), indent=1, ensure_ascii=True) + "\n"


def main() -> None:
    """Write it."""
    TABLE.write_text(text())
    print(TABLE)


if __name__ == "__main__":
    main()
