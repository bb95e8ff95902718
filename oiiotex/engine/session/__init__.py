# SPDX-License-Identifier: Apache-2.0
"""One run: settings, shared resources, progress."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

from .progress import Onlooker, Progress, Say, Tell
from .resources import Resources
from .settings import Settings


class Session:
    """The context of a run. Ops pass on its parts; the functions that they call never get the session itself.

    Parameters
    ----------
    progress, look, say, measure
        As in `Progress`; `progress` is its `tell`.
    settings
        As in `Settings`: device_name, threads, budget, colorconfig ...

    Attributes
    ----------
    resources : Resources
        Resources that are opened once, and shared by all stages of an op.
    progress : Progress
    """

    def __init__(
        self,
        *,
        progress: Tell | None = None,
        look: Onlooker | None = None,
        say: Say | None = None,
        measure: bool = False,
        **settings: Any,
    ):
        self.resources = Resources(Settings(**settings))
        self.progress = Progress(progress, look, say, measure)

    @classmethod
    def of(cls, resources: Resources, progress: Progress) -> Session:
        """A session from existing resources and progress."""
        session = cls.__new__(cls)
        session.resources, session.progress = resources, progress
        return session

    @property
    def settings(self) -> Settings:
        """The settings of the resources."""
        return self.resources.settings

    def change(self, **settings: Any) -> None:
        """Change settings from now on; open resources stay open."""
        self.resources.settings = replace(self.settings, **settings)

    def telling(self, progress: Progress) -> Session:
        """A session with the same resources and another progress."""
        return Session.of(self.resources, progress)

    def stages(self, *shares: float) -> Iterator[Session]:
        """A session for each stage, as `Progress.stages`."""
        return map(self.telling, self.progress.stages(*shares))
