# SPDX-License-Identifier: Apache-2.0
"""preset= of --texstationarize: three ways with structures, each a set of modifiers."""

from __future__ import annotations

import logging
import shlex
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from ..core.image import Image
from ..core.op import Op
from ..session import Session
from .dominant import Dominant

if TYPE_CHECKING:
    from .stationarize import Stationarize

log = logging.getLogger("oiiotex")

EVEN, CLEAN, KEEP = PRESETS = "even", "clean", "keep"
CONTRAST = 0.7  # how strongly the histogram is held
LARGE_PATCH = 21  # px
KEEP_SIGMA_SHARE, EVEN_SIGMA_SHARE = 4, 32  # of the longer side
SMALL_PATCH = 11  # px
PRESET_HELP = (
    "Modifiers for those that are not given. keep (large structures stay whole): sigma = longer side /"
    f" {KEEP_SIGMA_SHARE}, patch={LARGE_PATCH}; even (structures beyond sigma are evened out, too): sigma = longer"
    f" side / {EVEN_SIGMA_SHARE}, patch={SMALL_PATCH}; clean (objects are removed): as even, with contrast=0 and the"
    " mask of --texdominant. -v prints the line that makes the same pixels. Default: none of them."
)


def filled(op: Stationarize, session: Session) -> Stationarize:
    """The op with what its preset chooses where it was left out, and without preset; -v says its line.

    Parameters
    ----------
    op : Stationarize
        With a preset.
    """
    chosen: dict[str, Any] = {}
    if op.within is None:
        chosen["contrast"] = 0.0 if op.preset == CLEAN else CONTRAST
    chosen["patch"], share = (LARGE_PATCH, KEEP_SIGMA_SHARE) if op.preset == KEEP else (SMALL_PATCH, EVEN_SIGMA_SHARE)
    if op.amount is None and op.sigmamap is None:
        chosen["sigma"] = max(max(op.asked_size) / share, (op.patch or chosen["patch"]) / 4)
    plain = replace(op, preset=None, **{name: v for name, v in chosen.items() if getattr(op, name) is None})
    before = ""
    if op.preset == CLEAN and op.mask is None:
        plain.planned(session.resources, session.progress)  # what can be wrong is known before pixels are asked for
        dominant = Dominant(source=op.exemplar, data=op.data)
        part = op.exemplar.first
        mask = session.resources.remembered(
            ("dominant", id(part), op.data), lambda: dominant.compute(session)["dominant"], part
        )
        if mask.pixels().any():  # else it has warned
            plain = replace(plain, mask=Image((mask,), mask.name))
            before = f"{_words(dominant)}:keep=1 "
    others = "".join(f"{shlex.quote(image.source)} " for image in op.operands()[1:])
    log.info(
        "%s: preset=%s: the same as %s%s%s",
        op.flag(),
        op.preset,
        before,
        others,
        _words(plain, "mask" if before else ""),
    )
    return plain


def _words(op: Op, masked: str = "") -> str:
    """An op and its modifiers, but for those that are as when they are left out.

    Images come from the stack, but for the one called `masked`: that is the part 'dominant' of the first.
    """
    words = [op.flag()]
    optional = (slot.name for slot, _ in op.given() if slot in op.optional_images())
    words += [f"{name}={'dominant' if name == masked else 1}" for name in optional]
    for parameter in op.parameters():
        value = getattr(op, parameter.attribute)
        if value != parameter.default:
            words.append(f"{parameter.name}={int(value) if isinstance(value, bool) else shlex.quote(str(value))}")
    return ":".join(words)
