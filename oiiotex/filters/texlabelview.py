# SPDX-License-Identifier: Apache-2.0
"""--texlabelview: a contact sheet of label maps."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from ..engine.color.srgb import LUMA
from ..engine.core.access import ScanThenMap
from ..engine.core.attributes import SIGMA, SUPERPIXELS
from ..engine.core.image import Image
from ..engine.core.label_map import LabelMap, holds_ids, label_maps, required_ids
from ..engine.core.op import Kind, Output, Plan, Space
from ..engine.core.parameters import image
from ..engine.deferred import np
from ..engine.errors import ImageError, either, texture_filter
from ..engine.session import Session
from ..engine.session.facts import Facts
from ..surfaces.charts.drawing import Sheet, colored, label_tree, sampled, shown_pixels

_COLUMNS, _PANEL = 3, 384  # panels in a row; px of the longer side of one
_OPACITY = 0.65  # of the label colors over the photo


@dataclass(frozen=True, kw_only=True)
class LabelView(ScanThenMap):
    """Visualize label maps as a contact sheet of all levels, with the tree of labels.

    Takes the result of `label` or `superpixel`, preferably with `photo`. The sheet shows the photo, then each label
    part (uint32, one channel) in colors that color-blind viewers can distinguish, over the lightness of the photo and
    with borders. A label's color is close to that of its main parent, and its largest part has the same one. The tree
    has the coarsest labels at its top; the width of a node is the area of its label, and lines to parents other than
    the main one are faint. The result is an 8-bit sRGB image, subsampled from the labels, for display, not for
    measurement.
    """

    example: ClassVar[str] = '>>> sheet = filters.labelview(filters.label("photo.png", photo=True))'
    name: ClassVar[str] = "labelview"
    space: ClassVar[Space] = Space.ANY
    outputs: ClassVar[tuple[Output, ...]] = (Output("view", Kind.PICTURE, "Contact sheet."),)

    source: Image = image(help="Image with label parts, from `label` or `superpixel` with `photo`.")

    def plan(self, facts: Facts) -> Plan:
        """The label maps to show."""
        named = {id(one.part): one for one in label_maps(self.source).values()}
        # superpixels, and parts from formats without part names, belong to no level
        labels = [named.get(id(part), LabelMap(part, 0)) for part in self.source.parts if holds_ids(part)]
        if not labels:
            raise ImageError(
                f"has no label parts{either(' (other ops keep them only with -a)', '')}",
                subject=self.source.source,
                expected=f"a result of {texture_filter('label')} or {texture_filter('superpixel')}",
            )
        return Plan(work=labels)

    def make(self, plan: Plan, session: Session) -> dict[str, np.ndarray]:
        """The sheet."""
        labels = plan.work
        photo = None if holds_ids(self.source.first) else self.source.first
        spec = labels[0].part.spec
        step = max(1, -(-max(spec.width, spec.height) // _PANEL))
        maps = [required_ids(sampled(one.part, step)[..., 0], one.part.name).astype(np.int64) for one in labels]
        lightness, panels = None, []
        if photo is not None:
            picture = shown_pixels(sampled(photo, step), photo, session.resources)
            lightness = picture @ np.array(LUMA)
            panels.append(("photo", picture))
        for one, ids in zip(labels, maps, strict=True):
            panels.append((_title(one, ids), colored(ids, lightness, _OPACITY)))
        # superpixels are not part of the tree of levels
        levels = [n for n, one in enumerate(labels) if one.level] or list(range(len(labels)))
        tree = label_tree([labels[n] for n in levels], [maps[n] for n in levels])
        return {"view": Sheet.of_panels(panels, _COLUMNS, tree).image()}


def _title(labels: LabelMap, ids: np.ndarray) -> str:
    """Title of a panel: the name of the part, the number of labels and their scale."""
    count, scale, unit = labels.count, labels.scale, "labels"
    superpixels = labels.part.spec.get_int_attribute(SUPERPIXELS)
    if superpixels:
        count, scale, unit = superpixels, labels.part.spec.get_float_attribute(SIGMA), "superpixels"
    # small labels may have no pixel in the subsampled map
    return f"{labels.part.name}: {count or int(ids.max(initial=0))} {unit}" + (f" at {scale:.0f} px" if scale else "")
