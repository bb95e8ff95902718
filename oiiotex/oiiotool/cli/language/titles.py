# SPDX-License-Identifier: Apache-2.0
"""The names that oiiotool gives to computed images, in comparisons and in {TOP.filename}."""

from __future__ import annotations

from collections.abc import Sequence

from ....engine.core.image import Image
from ....engine.core.op import Op

_OTHERWISE = {
    "--resize": "resize", "--resample": "resample", "--pixelaspect": "resize", "--colorconvert": "colorconvert",
    "--tocolorspace": "colorconvert", "--fillholes": "filled", "--cryptomatte-colors": "cryptomatte_colors",
}  # fmt: skip
_AS_BEFORE = (
    "--clamp", "--fixnan", "--ch", "--nchannels", "--chappend", "--chnames", "--iscolorspace", "--attrib", "--sattrib",
    "--eraseattrib", "--caption", "--keyword", "--clear-keywords", "--orientation", "--orientcw", "--orientccw",
    "--orient180", "--origin", "--originoffset", "--fullsize", "--fullpixels", "--cicp", "--iccread", "--crop",
    "--croptofull", "--cut", "--trim", "--paste", "--mosaic", "--reorient", "--fit", "--box", "--line", "--point",
    "--text", "--fill", "--create", "--pattern",
)  # fmt: skip


def title_of(op: type[Op], operands: Sequence[Image], result: Image) -> str:
    """The result's name; '' for that of its source, as after all texture filters."""
    unchanged = bool(operands) and result.first is operands[0].first
    if unchanged or op.prefix == Op.prefix or op.flag() in _AS_BEFORE:
        return operands[0].first.title if operands and result.source == operands[0].source else ""
    return _OTHERWISE.get(op.flag(), op.flag()[1:])
