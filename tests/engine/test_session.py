# SPDX-License-Identifier: Apache-2.0
"""What one run shares."""

from __future__ import annotations

import functools
import threading
import tracemalloc
from dataclasses import FrozenInstanceError, replace

import numpy as np
import OpenImageIO as oiio
import pytest
from scipy.ndimage import gaussian_filter

from oiiotex import filters
from oiiotex.engine import errors
from oiiotex.engine.session import Session
from oiiotex.engine.session.progress import Progress
from oiiotex.engine.session.resources import Resources
from tests.any_filter import buffer


def test_stages_share_what_is_opened_once_and_go_on_counting():
    seen = []
    session = Session(progress=lambda done, total: seen.append((done, total)))
    stages = session.stages(1, 1)
    first = next(stages)
    for done in (1, 2):
        first.progress.advance(done, 2)
    second = next(stages)
    second.progress.advance(1, 3)
    assert seen == [(2500, 10000), (5000, 10000), (6667, 10000)]
    assert second.resources is first.resources is session.resources
    with pytest.raises(errors.Interrupted):  # a stage can be stopped
        next(Progress(lambda done, total: False).stages(1)).advance(1, 2)


def test_settings_change_for_all_that_share_resources():
    session = Session(threads=1, budget=1 << 20)
    other, before = session.telling(Progress()), session.settings
    session.change(budget=2 << 20)
    assert (before.budget, other.resources.budget, session.settings) == (
        1 << 20,
        2 << 20,
        replace(before, budget=2 << 20),
    )
    with pytest.raises(FrozenInstanceError):
        session.settings.budget = 0  # type: ignore[misc]
    with pytest.raises(TypeError, match="thread"):
        Session(thread=1)  # type: ignore[call-arg]


def peak_and_need(monkeypatch, work) -> tuple[int, int]:
    """Bytes that Python and numpy held at most, and that were asked for, in a run of its own."""
    needs, require = [], Resources.require

    def recording(self, need, *words):
        needs.append(need)
        require(self, need, *words)

    session = Session(threads=1)
    session.resources.color  # noqa: B018 - opened before
    with monkeypatch.context() as patch:
        patch.setattr(Resources, "require", recording)
        tracemalloc.start()
        try:
            work(session)
            return tracemalloc.get_traced_memory()[1], max(needs)
        finally:
            tracemalloc.stop()


@pytest.mark.parametrize("measure", ["histogram", "moments", pytest.param("steerable", marks=pytest.mark.slow), None])
def test_what_statistics_ask_for_is_what_they_hold(monkeypatch, measure):
    """Of grids alone: less what the same image takes with a few cells. Of one thread nothing waits to be added up."""
    photo = buffer(np.random.default_rng(0).random((160, 160, 3)).astype(np.float32))
    if measure is None:
        runs = [lambda s, radius=radius: filters.flatten(photo, radius=radius, session=s) for radius in (200, 4)]
    else:
        runs = [
            lambda s, sigma=sigma: filters.stationarity(photo, sigma=sigma, measure=measure, session=s)
            for sigma in (200, 2)
        ]
    runs[0](Session(threads=1))  # what is loaded once is loaded
    few, many = (peak_and_need(monkeypatch, run) for run in runs)
    held, asked = (b - a for a, b in zip(few, many, strict=True))
    assert 0.4 * asked < held <= asked, f"{held >> 10} kB held, {asked >> 10} kB asked for"


@pytest.mark.parametrize("op", ["content", "dominant", pytest.param("cut", marks=pytest.mark.slow)])
def test_what_is_asked_for_a_photo_is_what_is_held(monkeypatch, op):
    random = np.random.default_rng(0)
    photo = buffer(random.random((384, 384, 3)).astype(np.float32))
    ids = random.integers(1, 60, (48, 48, 1)).repeat(8, 0).repeat(8, 1).astype(np.uint32)
    labels = oiio.ImageBuf(oiio.ImageSpec(384, 384, 1, oiio.UINT32))
    labels.set_pixels(labels.roi, ids)
    if op == "cut":
        run = functools.partial(filters.cut, photo, patch=190, passes=0)
    elif op == "dominant":  # of what has as many components as its patches have values
        noise = gaussian_filter(random.random((96, 96, 3)).astype(np.float32), (0.6, 0.6, 0))
        run = functools.partial(filters.dominant, buffer(noise), patch=15)
    else:
        run = functools.partial(filters.content, {"photo": photo, "label.1": labels}, patch=16)
    run(session=Session())  # what is loaded once is loaded
    held, asked = peak_and_need(monkeypatch, lambda session: run(session=session))
    assert 0.4 * asked < held <= asked, f"{held >> 10} kB held, {asked >> 10} kB asked for"


@pytest.mark.parametrize(("need", "apart"), [(8 << 20, True), ((8 << 20) + 1, False)])
def test_work_of_much_memory_does_not_run_in_the_background(need, apart):
    resources = Session(threads=2, budget=64 << 20).resources
    with resources.in_background(threading.get_ident, need) as thread:
        assert (thread() != threading.get_ident()) == apart
