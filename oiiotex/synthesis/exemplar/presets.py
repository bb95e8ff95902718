# SPDX-License-Identifier: Apache-2.0
"""preset= of --texstationarize: treatments of structures, three of them sets of modifiers."""

from __future__ import annotations

import shlex
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from ...engine.core.image import Image, Part
from ...engine.core.op import Op
from ...engine.session.progress import Progress
from ...engine.session.resources import Resources
from .patch_synthesis import PATCH

if TYPE_CHECKING:
    from .patch_synthesis import PatchSynthesis, SynthesisPlan

_DOMINANT = "--texdominant"
EVEN, CLEAN, LARGE, LAYOUT = "even", "clean", "large", "layout"
CONTRAST = 0.7  # strength of histogram matching
LARGE_PATCH, SMALL_PATCH = 21, 11  # px
SIGMA_SHARE, PAPER_SIGMA_SHARE, LARGE_SIGMA_SHARE, EVEN_SIGMA_SHARE = 8, 32, 4, 32  # sigma is the longer side / share
AUTOMATIC: dict[str, float] = {"histogram": CONTRAST, "patch": PATCH, "share": SIGMA_SHARE}  # without a preset
IMPROVED_BY_SIZE = "broken", "cut", "unlike", "lost", "missing", "salient"  # large structures repeat as slow waves
REPEATED = ("waves",)  # what a kept layout repeats sooner: it is smaller, and whole objects are preferred by eye
# other tiles: divisor of the longer side, patch, parts of a fidelity that they may improve, and whether they even out
EVENER = (
    (EVEN_SIGMA_SHARE, SMALL_PATCH, ("waves", "uneven", "salient"), True),
    (2 * SIGMA_SHARE, PATCH, ("waves", "uneven"), False),
)
LARGER = LARGE_SIGMA_SHARE, LARGE_PATCH, IMPROVED_BY_SIZE, False
PRESETS: dict[str, dict[str, float]] = {  # values of modifiers
    EVEN: {"histogram": CONTRAST, "patch": SMALL_PATCH, "share": EVEN_SIGMA_SHARE},
    CLEAN: {"histogram": 0.0, "patch": SMALL_PATCH, "share": EVEN_SIGMA_SHARE},
    LARGE: {"histogram": CONTRAST, "patch": LARGE_PATCH, "share": LARGE_SIGMA_SHARE},
    LAYOUT: AUTOMATIC,  # at that scale the tile is measured, and its holes are filled
}
PRESET_HELP = (
    f"Values for modifiers that you do not set. large: large structures are preserved (sigma = longer side /"
    f" {LARGE_SIGMA_SHARE}, patch={LARGE_PATCH}). even: large structures are also evened out (sigma = longer side /"
    f" {EVEN_SIGMA_SHARE}, patch={SMALL_PATCH}). clean: objects are also removed (as even, with histogram=0 and a mask"
    " from `dominant`). layout: the photo's own layout is kept, and joined at its best period along minimum-error"
    " seams. Objects stay whole, and the tile is smaller than the photo."
)


def filled(op: Any, preset: str) -> Any:
    """The op with its preset replaced by values for modifiers that were not given."""
    chosen: dict[str, Any] = dict(PRESETS[preset])
    share = chosen.pop("share")
    if op.evenness is None and op.sigmamap is None:
        chosen["sigma"] = max(max(op.asked_size) / share, (op.patch or chosen["patch"]) / 4)
    missing: dict[str, Any] = {name: value for name, value in chosen.items() if getattr(op, name) is None}
    return replace(op, **missing | {"preset": None})


def masked(plan: SynthesisPlan, given: PatchSynthesis, resources: Resources, progress: Progress) -> PatchSynthesis:
    """The op of the plan, with the mask of its preset if that has one. -v logs the equivalent line of op `given`."""
    op, before = plan.op, ""
    if plan.dominant:
        part = op.exemplar.first
        mask = resources.remembered(("dominant", id(part), op.data), lambda: _dominant(op, resources, progress), part)
        if mask.pixels().any():  # otherwise it has warned
            op = replace(op, mask=Image((mask,), mask.name))
            before = f"{_DOMINANT}{':data=1' * op.data}:photo=1 "
    others = "".join(f"{shlex.quote(image.source)} " for image in given.operands()[1:])
    line = _words(op, "mask" if before else "")
    given.inform("preset=%s is equivalent to %s%s%s", plan.preset, before, others, line)
    return op


def _dominant(op: PatchSynthesis, resources: Resources, progress: Progress) -> Part:
    from ...analysis.dominant.photo_mask import photo_mask  # scipy loads slowly

    return photo_mask(_DOMINANT, op.exemplar, op.working_space, resources, progress).part


def _words(op: Op, masked: str = "") -> str:
    """An op and its modifiers that differ from their defaults.

    Images come from the stack, except `masked`, which is part 'dominant' of the first image.
    """
    words = [op.flag()]
    optional = (slot.name for slot, _ in op.given() if slot in op.optional_images())
    words += [f"{name}={'dominant' if name == masked else 1}" for name in optional]
    for parameter in op.parameters():
        value = getattr(op, parameter.attribute)
        if value != parameter.default:
            words.append(f"{parameter.name}={int(value) if isinstance(value, bool) else shlex.quote(str(value))}")
    return ":".join(words)
