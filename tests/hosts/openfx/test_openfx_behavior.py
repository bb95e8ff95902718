# SPDX-License-Identifier: Apache-2.0
"""What a compositor expects: color that is never guessed, windows, frames, abort, and a process that may end."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable

import numpy as np
import pytest

from oiiotex.engine.session import Session
from oiiotex.oiiotool.service.client import connect
from oiiotex.oiiotool.service.settings import ResidentSettings
from tests.hosts.openfx.conftest import SPACE, edited, photo, region, rendered, with_source
from tests.hosts.openfx.host import FAILED, OK, REPLY_DEFAULT, Host, Image, Node

WHOLE = (0, 0, 96, 64)


def identity(node: Node) -> int:
    status, out = node.ask("OfxImageEffectActionIsIdentity", OfxPropTime=0.0)
    if status == OK:
        assert (out["OfxPropName"], out["OfxPropTime"]) == ("Source", 0.0)
    return status


def test_without_a_color_space_it_says_so_and_passes_its_input_on(host: Host):
    pixels = photo()
    node = with_source(host, "Tile", pixels)
    assert identity(node) == REPLY_DEFAULT
    node.parameters["colorspace"].set("")
    assert identity(node) == OK
    assert len(node.messages) == 1 and "choose that of Source in colorspace" in node.messages[0]
    out = Image(host, np.zeros_like(pixels), padding=16)
    assert host.render(node, WHOLE, out) == OK
    np.testing.assert_array_equal(out.rows(), pixels)
    node.parameters["data"].set(1)
    assert identity(node) == REPLY_DEFAULT
    node.parameters["data"].set(0)
    for vague in ("ofx_scene_linear", "OfxColourspace_Source"):  # a family of spaces, another clip
        node.clips["Source"].properties.put("OfxImageClipPropColourspace", vague)
        assert identity(node) == OK
    node.clips["Source"].properties.put("OfxImageClipPropColourspace", SPACE)  # OpenFX 1.5
    assert identity(node) == REPLY_DEFAULT


def test_the_space_is_the_one_that_is_chosen(host: Host):
    node = with_source(host, "Flatten", photo())
    linear = rendered(host, node).copy()
    node.parameters["spaces"].set(node.parameters["spaces"].values[0])
    options = host.described("Flatten", "General").parameters["spaces"]["OfxParamPropChoiceOption"]
    node.parameters["spaces"].set(options.index("ACEScct"))
    assert edited(node, "spaces") == OK
    assert node.parameters["colorspace"].values == [b"ACEScct"] and node.parameters["spaces"].values == [0]
    assert not np.array_equal(rendered(host, node), linear)
    assert '--iscolorspace "ACEScct"' in node.parameters["line"].values[0].decode()
    node.parameters["colorspace"].set("no such space")
    assert host.render(node, WHOLE, Image(host, photo())) == FAILED
    assert len(node.messages) == 1 and "no such space" in node.messages[0] and "\n" not in node.messages[0]


def test_the_config_is_the_one_of_the_host(host: Host):
    node = with_source(host, "Flatten", photo())
    node.properties.put("OfxImageEffectPropOCIOConfig", "/nowhere/config.ocio")
    try:
        assert host.render(node, WHOLE, Image(host, photo())) == FAILED
        assert len(node.messages) == 1 and "/nowhere/config.ocio" in node.messages[0]
    finally:  # each config has a process
        connect(ResidentSettings.of(Session(device_name=None, colorconfig="/nowhere/config.ocio"))).end()


CONFIG = """ocio_profile_version: 2
roles:
  scene_linear: show_linear
  cie_xyz_d65_interchange: xyz
file_rules:
  - !<Rule> {name: Default, colorspace: show_linear}
displays:
  screen:
    - !<View> {name: plain, colorspace: show_linear}
colorspaces:
  - !<ColorSpace>
    name: show_linear
  - !<ColorSpace>
    name: xyz
"""


@pytest.mark.parametrize("by_host", [True, False])
def test_the_menu_lists_the_spaces_of_the_config(host: Host, tmp_path, monkeypatch, by_host: bool):
    """That of the host, or $OCIO; the built-in one is described without a process."""
    (tmp_path / "config.ocio").write_text(CONFIG)
    config = str(tmp_path / "config.ocio")
    built_in = host.described("Flatten", "General").parameters["spaces"]["OfxParamPropChoiceOption"]
    assert len(built_in) > 30
    try:
        if not by_host:
            monkeypatch.setenv("OCIO", config)
            assert host.described("Flatten", "General").parameters["spaces"]["OfxParamPropChoiceOption"] == "choose ..."
        node = host.instance("Flatten", OfxImageEffectPropOCIOConfig=config) if by_host else host.instance("Flatten")
        menu = node.parameters["spaces"].properties["OfxParamPropChoiceOption"]
        assert menu == ["choose ...", "cie_xyz_d65_interchange", "scene_linear", "show_linear", "xyz"]
        node.parameters["spaces"].set(3)
        assert edited(node, "spaces") == OK
        assert node.parameters["colorspace"].values == [b"show_linear"]
    finally:  # each config has a process
        connect(ResidentSettings.of(Session(device_name=None, colorconfig=config))).end()


def test_the_line_and_the_verdict_are_told(host: Host):
    node = with_source(host, "Tile", photo(), sigma=8.0, iterations=3, preset=1)
    assert edited(node, "sigma") == OK
    line = f'oiiotex Source.exr --iscolorspace "{SPACE}" --texstationarize:iterations=3:preset=even:sigma=8 -o Tile.exr'
    assert node.parameters["line"].values == [line.encode()]
    assert edited(node, "check") == OK, node.messages
    verdict = node.parameters["verdict"].values[0].decode()
    assert any(f"{grade}:" in verdict for grade in ("good", "fair", "poor"))
    assert node.parameters["line"].values == [line.encode()]


def test_a_still_comes_from_one_frame(host: Host):
    frames = {float(n): Image(host, photo(seed=n)) for n in (1, 2, 3)}
    node = with_source(host, "Tile", photo(seed=1), iterations=3, lattice=0.0)
    clip = node.clips["Source"]
    clip.connect(lambda time: frames[time], (1.0, 3.0))

    def made(time: float) -> np.ndarray:
        out = Image(host, np.zeros_like(photo()))
        assert host.render(node, WHOLE, out, time=time) == OK, node.messages
        return out.rows()

    first = made(1.0)
    clip.asked.clear()
    np.testing.assert_array_equal(made(3.0), first)
    assert set(clip.asked) == {1.0}
    status, out = node.ask("OfxImageEffectActionGetFramesNeeded", OfxPropTime=3.0)
    assert status == OK and out["OfxImageClipPropFrameRange_Source"] == [1.0, 1.0]
    node.parameters["frame"].set(2)
    second = made(3.0)
    assert not np.array_equal(second, first)
    node.parameters["hold"].set(0)
    np.testing.assert_array_equal(made(2.0), second)
    assert not np.array_equal(made(3.0), second)
    status, out = node.ask("OfxImageEffectActionGetFramesNeeded", OfxPropTime=3.0)
    assert out["OfxImageClipPropFrameRange_Source"] == [3.0, 3.0]


def test_regions(host: Host):
    node = with_source(host, "Quilt", photo(), size=(200, 150))
    node.clips["Source"].connect(Image(host, photo(), (10, 20)))
    assert region(node) == (10, 20, 210, 170)
    given = {"OfxPropTime": 0.0, "OfxImageEffectPropRegionOfInterest": (10.0, 20.0, 11.0, 21.0)}
    status, out = node.ask("OfxImageEffectActionGetRegionsOfInterest", **given)
    assert status == OK and out["OfxImageClipPropRoI_Source"] == [10.0, 20.0, 106.0, 84.0]
    status, out = node.ask("OfxImageEffectActionGetOutputColourspace")
    assert (status, out["OfxImageClipPropColourspace"]) == (OK, "OfxColourspace_Source")
    node.parameters["output"].set(1)
    assert node.ask("OfxImageEffectActionGetOutputColourspace")[1]["OfxImageClipPropColourspace"] == "ofx_raw"
    generator = host.instance("Synthesize", "Generator")
    status, out = generator.ask("OfxImageEffectActionGetClipPreferences")
    assert status == OK and out["OfxImageClipPropComponents_Output"] == "OfxImageComponentRGBA"
    status, out = node.ask("OfxImageEffectActionGetClipPreferences")  # source coordinates are no color
    assert status == OK and out["OfxImageEffectPropPreMultiplication"] == "OfxImageOpaque"


def test_unknown_actions_and_broken_calls_are_status_codes(host: Host):
    node = host.instance("Flatten")
    assert node.do("OfxActionNoSuchThing") == REPLY_DEFAULT
    assert node.do("OfxImageEffectActionRender", OfxPropTime=0.0) == FAILED
    assert node.plugin.main(b"OfxImageEffectActionRender", None, None, None) == FAILED
    assert node.plugin.main(None, node.handle, None, None) == REPLY_DEFAULT


def test_eight_threads_get_what_one_gets(host: Host):
    sources = [photo(seed=seed) for seed in range(1, 5)]
    nodes = [with_source(host, "Flatten", pixels) for pixels in sources]
    wanted = [rendered(host, node).copy() for node in nodes]
    found: list[tuple[int, Image, int]] = []

    def work(number: int, bottom: int) -> None:
        node = with_source(host, "Flatten", sources[number], radius=float(50 + number))
        out = Image(host, np.zeros((64, 96, 4), np.float32))
        node.parameters["radius"].set(0.0)
        found.append((host.render(node, (0, bottom, 96, bottom + 32), out), out, number))

    with host.threads(8) as start:
        for number in range(4):
            for bottom in (0, 32):
                start(lambda number=number, bottom=bottom: work(number, bottom))
    assert [status for status, _, _ in found] == [OK] * 8
    for _, out, number in found:
        rows = out.rows()
        half = rows[32:] if rows[40:].any() else rows[:32]
        np.testing.assert_array_equal(half, wanted[number][32:] if rows[40:].any() else wanted[number][:32])


def test_a_render_stops_when_the_host_aborts(host: Host):
    """Without waiting for the process, which ends the job at its next report."""
    node = with_source(host, "Tile", photo(512, 512), iterations=300)
    asked = threading.Event()
    node.abort = asked.is_set
    threading.Timer(0.7, asked.set).start()
    out = Image(host, np.zeros((512, 512, 4), np.float32))
    assert host.render(node, (0, 0, 512, 512), out) == OK
    assert asked.is_set() and not out.rows().any()  # it did not finish
    assert out.guarded()


def test_progress_is_told(host: Host):
    node = with_source(host, "Tile", photo(192, 192, seed=9), iterations=40)
    assert host.render(node, (0, 0, 192, 192), Image(host, np.zeros((192, 192, 4), np.float32))) == OK
    assert node.progress and all(0 <= share <= 1 for share in node.progress)


def test_a_process_that_is_killed_is_started_again(host: Host, resident: Callable[[], int]):
    node = with_source(host, "Flatten", photo())
    wanted = rendered(host, node).copy()
    for radius in (11.0, 12.0):
        before = resident()
        os.kill(before, signal.SIGKILL)
        node.parameters["radius"].set(radius)
        assert rendered(host, node).shape == wanted.shape
        assert resident() != before
    node.parameters["radius"].set(0.0)
    np.testing.assert_array_equal(rendered(host, node), wanted)


def test_a_frame_that_was_shown_needs_no_process(host: Host, resident: Callable[[], int]):
    pixels = photo(seed=7)
    shown = rendered(host, with_source(host, "Flatten", pixels))
    process = resident()
    os.kill(process, signal.SIGSTOP)
    try:
        np.testing.assert_array_equal(rendered(host, with_source(host, "Flatten", pixels.copy())), shown)
    finally:
        os.kill(process, signal.SIGCONT)


@pytest.mark.parametrize(
    ("python", "text"),
    [
        ("/bin/false", "/bin/false cannot start oiiotex"),
        ("/nowhere/python", "set OIIOTEX_PYTHON to a Python with oiiotex"),
        ("python3", "expected the absolute path of a Python with oiiotex"),
    ],
)
def test_an_absent_process_is_one_message_with_the_remedy(plugin, tmp_path, python, text):
    """In a program of its own: this one has a process already."""
    lines = f"""
from pathlib import Path
from tests.hosts.openfx.conftest import photo, with_source
from tests.hosts.openfx.host import Host, Image
host = Host(Path({str(plugin)!r}))
node = with_source(host, "Flatten", photo())
print(host.render(node, (0, 0, 96, 64), Image(host, photo())), len(node.messages), node.messages[0])
"""
    environment = os.environ | {"OIIOTEX_PYTHON": python, "PYTHONPATH": os.pathsep.join(sys.path)}
    done = subprocess.run([sys.executable, "-c", lines], env=environment, capture_output=True, text=True, timeout=120)
    assert done.stdout.startswith("1 1 ") and text in done.stdout, done.stderr
