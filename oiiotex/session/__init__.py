# SPDX-License-Identifier: Apache-2.0
"""One run: its settings, what it opens once and shares, its progress."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Unpack

from .progress import Onlooker, Progress, Say, Tell
from .resources import Resources
from .settings import Changes, Settings


class Session:
    """What an op is run with. Ops take from it what the functions below them need, which never see it whole.

    Parameters
    ----------
    progress, look, say, measure
        As `Progress` has them; `progress` is its `tell`.
    settings
        As `Settings` has them: device_name, threads, budget, colorconfig ...

    Attributes
    ----------
    resources : Resources
        What is opened once, also where an op works in stages.
    progress : Progress
    """

    def __init__(
        self,
        *,
        progress: Tell | None = None,
        look: Onlooker | None = None,
        say: Say | None = None,
        measure: bool = False,
        **settings: Unpack[Changes],
    ):
        self.resources = Resources(Settings(**settings))
        self.progress = Progress(progress, look, say, measure)

    @classmethod
    def of(cls, resources: Resources, progress: Progress) -> Session:
        """One of what is there already."""
        session = cls.__new__(cls)
        session.resources, session.progress = resources, progress
        return session

    @property
    def settings(self) -> Settings:
        """Those by which resources are opened."""
        return self.resources.settings

    def change(self, **settings: Unpack[Changes]) -> None:
        """Keep to other settings from here on; what has been opened stays open."""
        self.resources.settings = replace(self.settings, **settings)

    def telling(self, progress: Progress) -> Session:
        """A session with the same resources, whose progress others hear."""
        return Session.of(self.resources, progress)

    def stages(self) -> Iterator[Session]:
        """This session again and again, as `Progress.stages`."""
        return map(self.telling, self.progress.stages())
