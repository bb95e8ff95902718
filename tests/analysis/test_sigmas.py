# SPDX-License-Identifier: Apache-2.0
"""--texsigmas and :evenness=: perceptually motivated control of sigma (MJH17 section 4.4)."""

from __future__ import annotations

import json
import logging

import numpy as np
import OpenImageIO as oiio
import pytest
from scipy.stats import wasserstein_distance

from oiiotex import filters
from oiiotex.engine import errors
from oiiotex.engine.core.image import from_buffer
from oiiotex.engine.io.atomic import _host
from oiiotex.engine.session import Session
from oiiotex.filters.texstationarize import Stationarize
from oiiotex.synthesis.exemplar import sigma_scale
from oiiotex.synthesis.exemplar.sigma_scale import SigmaTiles, distance, perceived_scale, variation
from tests import pictures
from tests.analysis.test_deviation import lab_of
from tests.any_filter import buffer, pixels
from tests.refusals import refused


@pytest.fixture(autouse=True)
def quick(monkeypatch, tmp_path):
    """A cache of the test's own, and scales that take no time."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    for name, value in (("SIDE", 48), ("SEEDS", 1), ("ROUNDS", 1), ("_ITERATIONS", 2)):
        monkeypatch.setattr(sigma_scale, name, value)


def photo() -> oiio.ImageBuf:
    return buffer(pictures.stained(pictures.pebbles(64, 80, 1)))


def palette(device, image: oiio.ImageBuf) -> SigmaTiles:
    lab = lab_of(pixels(image))
    recipe = Stationarize(exemplar=from_buffer(image)).recipe(80, 64)
    return SigmaTiles(device, lab, None, recipe, 1 << 30, "nothing")


def test_the_distance_is_the_earth_movers():
    a, b = np.random.default_rng(0).normal(size=(2, 200, 3)) * [1, 5, 20] + [0, 3, 7]
    wanted = sum(wasserstein_distance(a[:, c], b[:, c]) for c in range(3))
    assert distance(np.sort(a, 0), np.sort(b, 0)) == pytest.approx(wanted)


def test_a_scale_is_inverted_so_that_steps_are_even(device, monkeypatch):
    """Tiles whose brightness hangs on sigma in a known way: what is found must undo it."""
    made = palette(device, photo())

    def tile(self, sigma, seed, advance):
        seen = 50 + 40 * np.tanh(3 * np.log(sigma / 6))  # all of the change happens about 6 px
        return np.full((4, 4, 3), seen, np.float32)

    monkeypatch.setattr(SigmaTiles, "tile", tile)
    monkeypatch.setattr(sigma_scale, "ROUNDS", 3)
    scale = made.scale(9, lambda done, total: None)
    assert variation(scale.first_steps) > 1
    assert variation(scale.steps) < 0.2
    assert (scale.sigma_at(1), scale.sigma_at(0)) == pytest.approx(made.limits())
    assert scale.sigma_at(0.5) == pytest.approx(6, rel=0.2)
    np.testing.assert_allclose(scale.amounts(scale.sigmas), np.linspace(1, 0, 9), atol=1e-6)
    np.testing.assert_allclose(
        scale.steps.sum(), 3 * np.ptp(50 + 40 * np.tanh(3 * np.log(scale.sigmas / 6))), rtol=1e-5
    )


def test_what_does_not_change_with_sigma_has_a_scale_all_the_same(device):
    made = palette(device, buffer(np.full((64, 80, 3), 0.4)))
    scale = made.scale(5, lambda done, total: None)
    assert not scale.steps.any()
    np.testing.assert_allclose(scale.sigmas, np.geomspace(*made.limits(), 5), rtol=0.02)


def test_a_scale_is_kept_by_what_it_follows_from(device, tmp_path, monkeypatch):
    folder, made = tmp_path / "kept", palette(device, photo())
    first = perceived_scale(made, 4, lambda done, total: None, folder)
    (file,) = folder.iterdir()

    def never(*_):
        raise AssertionError("made again")

    with monkeypatch.context() as patched:
        patched.setattr(SigmaTiles, "tile", never)
        again = perceived_scale(palette(device, photo()), 4, never, folder)
        for name in vars(first):
            np.testing.assert_array_equal(getattr(first, name), getattr(again, name))
        with pytest.raises(AssertionError):
            perceived_scale(made, 5, never, folder)
        with pytest.raises(AssertionError):
            perceived_scale(palette(device, buffer(pictures.pebbles(64, 80, 2))), 4, never, folder)
    for spoiled in (b"", b"\x93NUMPY nonsense", np.zeros(3).tobytes()):
        file.write_bytes(spoiled)
        assert perceived_scale(made, 4, lambda done, total: None, folder).sigma_at(0.3) == first.sigma_at(0.3)
    left = folder / f".x.oiiotex-{_host()}-999999999-{0:016x}.npy"
    left.write_bytes(b"half")
    file.unlink()
    perceived_scale(made, 4, lambda done, total: None, folder)
    assert list(folder.iterdir()) == [file]  # what an interrupted run left is swept


def test_amount_stands_for_the_sigma_of_the_scale(caplog):
    with caplog.at_level(logging.INFO, "oiiotex"):
        made = filters.stationarize(photo(), evenness=0.4, iterations=2)
    line = next(r.getMessage() for r in caplog.records if "evenness" in r.getMessage())
    assert line.startswith("--texstationarize: evenness=0.4 corresponds to sigma=")
    sigma = float(line.split("=")[-1].removesuffix(" px"))
    low, high = 80 / 64, 80 / 2
    assert low < sigma < high
    ends = [filters.stationarize(photo(), evenness=a, iterations=2) for a in (0, 1)]
    for one, limit in zip(ends, (high, low), strict=True):
        np.testing.assert_array_equal(pixels(one), pixels(filters.stationarize(photo(), sigma=limit, iterations=2)))
    assert (pixels(made) != pixels(ends[0])).any()


def test_the_sheet_and_its_table(tmp_path):
    said: list[str] = []
    seen: list[tuple[int, int]] = []
    session = Session(say=said.append, progress=lambda done, total: seen.append((done, total)))
    sheet = filters.sigmas(photo(), count=4, facts=tmp_path / "t.json", session=session)
    assert (sheet.spec().nchannels, sheet.spec().format) == (3, oiio.UINT8)
    assert sheet.spec().width > 3 * 2 * 48 and sheet.spec().height > 2 * 2 * 38  # tiles 2 x 2, in two rows
    facts = json.loads((tmp_path / "t.json").read_text())
    for name in ("before", "after"):
        table = facts[name]["table"]
        assert len(table) == 4 and table[-1]["step"] is None
        assert [row["sigma"] for row in table] == sorted((row["sigma"] for row in table), reverse=True)
        amounts = [row["evenness"] for row in table]
        assert amounts == sorted(amounts) and (amounts[0], amounts[-1]) == pytest.approx((0, 1))
        steps = np.array([row["step"] for row in table[:-1]])
        assert facts[name]["variation"] == pytest.approx(steps.std() / steps.mean())
        assert f"{name}: coefficient of variation of the steps {facts[name]['variation']:.3f}" in said
    assert [row["evenness"] for row in facts["after"]["table"]] == pytest.approx([0, 1 / 3, 2 / 3, 1])
    assert [done for done, _ in seen] == list(range(1, 4 * 2 + 1))


def test_what_goes_wrong_says_what_is_allowed(fails, photo):
    line = fails(photo, "--texstationarize:evenness=nan")
    assert "evenness=nan" in line and " from 0 to 1" in line
    assert "would overwrite exemplar, an input image" in fails(photo, f"--texsigmas:facts={photo}")
    image = buffer(pictures.bricks(40, 40, 1))
    for value in (-0.1, 1.01):
        with pytest.raises(errors.ParameterError, match=rf"evenness={value}: .* from 0 to 1"):
            filters.stationarize(image, evenness=value)
    with refused(errors.ParameterError, parameter="evenness", value=0.5, problem="conflicts with sigma=8"):
        filters.stationarize(image, evenness=0.5, sigma=8)
    with refused(errors.ParameterError, parameter="count", value=2, expected="an integer from 3 to 32"):
        filters.sigmas(image, count=2)
    broken = pictures.bricks(40, 40, 1)
    broken[3, 5, 0] = np.nan
    for call in (filters.sigmas, lambda b: filters.stationarize(b, evenness=0.5)):
        with refused(errors.ImageError, counts=[1, 0]):
            call(buffer(broken))


def test_sigmamap_and_amount_do_not_go_together():
    sigmas = buffer(np.full((64, 80, 1), 8.0), space="data", names=("Y",))
    with refused(errors.ParameterError, parameter="evenness", value=0.5, problem="conflicts with sigmamap"):
        filters.stationarize(photo(), evenness=0.5, sigmamap=sigmas)


def test_a_run_can_be_stopped_while_a_scale_is_found():
    with pytest.raises(errors.Interrupted):
        filters.stationarize(photo(), evenness=0.5, session=Session(progress=lambda done, total: done < 2))


def test_neither_threads_nor_lanes_show_in_a_sheet(narrow_device, tmp_path, monkeypatch):
    whole = pixels(filters.sigmas(photo(), count=3))
    for n, session in enumerate((Session(threads=1), Session())):
        monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / f"empty{n}"))
        if n:
            session.resources.device = narrow_device
        np.testing.assert_array_equal(pixels(filters.sigmas(photo(), count=3, session=session)), whole)
