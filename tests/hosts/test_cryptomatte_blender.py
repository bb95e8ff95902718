# SPDX-License-Identifier: Apache-2.0
"""Blender's own compositor picks labels by name from what --texlabel:cryptomatte=1 writes.

Requires bpy (PyPI, Python 3.11) in an environment of its own, since it pins an older NumPy: `make blender` makes one,
and OIIOTEX_BLENDER=/path/to/python names another.
"""

from __future__ import annotations

import os
import platform
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.ndimage import maximum_filter, minimum_filter

from tests.analysis.test_label_parts import ids_of, parts_of
from tests.analysis.test_labels import quarters
from tests.conftest import load, oiiotex, save

MADE = Path(sys.prefix) / "blender" / "bin" / "python"  # by `make blender`
BLENDER = os.environ.get("OIIOTEX_BLENDER") or (str(MADE) if MADE.exists() else None)
HAS_WHEEL = sys.version_info[:2] == (3, 11) and (sys.platform, platform.machine()) == ("linux", "x86_64")
needs_blender = pytest.mark.skipif(
    BLENDER is None,
    reason="no bpy: make blender" if HAS_WHEEL else "no bpy: its wheels are for Python 3.11 on x86-64 Linux",
)
pytestmark = needs_blender
SIDE = 128
SCRIPT = f"""
import sys
import bpy
file, layer, name, out = sys.argv[1:]
scene = bpy.context.scene
tree = bpy.data.node_groups.new("compositing", "CompositorNodeTree") if bpy.app.version >= (5, 0) else None
if tree is not None:
    scene.compositing_node_group = tree
    tree.interface.new_socket(name="Image", in_out="OUTPUT", socket_type="NodeSocketColor")
    result = tree.nodes.new("NodeGroupOutput")
else:
    scene.use_nodes = True
    tree = scene.node_tree
    tree.nodes.clear()
    result = tree.nodes.new("CompositorNodeComposite")
matte = tree.nodes.new("CompositorNodeCryptomatteV2")
matte.source, matte.image = "IMAGE", bpy.data.images.load(file)
matte.layer_name, matte.matte_id = layer, name
tree.links.new(matte.outputs["Matte"], result.inputs[0])
scene.render.engine = "CYCLES"
scene.render.resolution_x = scene.render.resolution_y = {SIDE}
scene.render.resolution_percentage = 100
scene.render.image_settings.file_format, scene.render.image_settings.color_depth = "OPEN_EXR", "32"
scene.view_settings.view_transform = "Raw"
scene.render.filepath = out
bpy.ops.render.render(write_still=True)
"""


def matte(file: Path, layer: str, name: str) -> np.ndarray:
    """(h, w) float: what the compositor makes of a name."""
    out = file.with_name("matte.exr")
    out.unlink(missing_ok=True)
    command = [BLENDER, "-c", SCRIPT, str(file), layer, name, str(out)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0 and out.exists(), done.stdout + done.stderr
    return load(out)[..., 0]


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """Labels behind their photo in all.exr; the Cryptomatte alone in picks.exr, as Blender reads it."""
    made = tmp_path_factory.mktemp("blender")
    save(quarters(SIDE)[0], made / "photo.png")
    for words in (
        ["photo.png", "--texlabel:photo=1:cryptomatte=1", "-o", "all.exr"],
        ["photo.png", "--texlabel:cryptomatte=1:onepart=1", "-o", "picks.exr"],
    ):
        done = oiiotex(*words, cwd=made)
        assert done.returncode == 0, done.stderr
    return made


@pytest.mark.parametrize("level", [1, 2])
def test_blender_picks_a_label_by_its_name(folder, level):
    ids = ids_of(parts_of(folder / "all.exr")[f"label.{level}"])
    for label in (1, int(ids.max())):
        assert 0 < (ids == label).sum() < ids.size
        found = matte(folder / "picks.exr", f"label{level}_", f"label.{level}/{label}")
        mine = (ids == label).astype(np.float32)
        inside = maximum_filter(ids, 3) == minimum_filter(ids, 3)  # borders are soft
        np.testing.assert_array_equal(found[inside], mine[inside])
        assert np.abs(found - mine).max() <= 0.75 and ((found > 0) & (found < 1)).any()


def test_a_name_that_no_label_has_is_an_empty_matte(folder):
    assert not matte(folder / "picks.exr", "label1_", "label.1/999").any()
