# SPDX-License-Identifier: Apache-2.0
"""The exemplar of an op that makes all maps of a material anew together."""

from __future__ import annotations

from dataclasses import dataclass

from ..core.demand import SomeRows
from ..core.image import Image
from ..core.parameters import Numbers, Words, image, param
from ..deferred import np
from ..errors import ParameterError
from ..session.resources import Resources
from .exemplar_op import ExemplarOp
from .materials import KINDS_HELP, MATCH_HELP, read_material


@dataclass(frozen=True, kw_only=True)
class MaterialOp(ExemplarOp):
    """What is copied together from one photo, or from the n maps of one material."""

    exemplar: Image = image(help="the photo; of n maps of a material, the first")
    maps: tuple[Image, ...] = image((), help="the other maps of the material, made anew with it", count="n")
    n: int = param(1, ge=1, le=16, help="how many maps of one material are made together, the last images of the stack")
    kinds: Words | None = param(None, help=KINDS_HELP)
    match: Numbers | None = param(None, ge=0, help=MATCH_HELP)

    def seen(self, resources: Resources) -> tuple[SomeRows, np.ndarray | None]:
        """All maps of the material together."""
        held = self.holds_photo(resources)
        return read_material(self.all_maps(), self.kinds, self.match, self.data, resources, held)

    def holds_photo(self, resources: Resources) -> bool:
        """Whether the values of all maps lie in memory, and not in a file."""
        return True

    def all_maps(self) -> tuple[Image, ...]:
        """The exemplar and the others; raises ParameterError where they are not as many as n says."""
        maps = (self.exemplar, *self.maps)
        if self.n != len(maps):
            raise ParameterError(f"n={self.n}: there are {len(maps)} maps")
        return maps
