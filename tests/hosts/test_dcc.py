# SPDX-License-Identifier: Apache-2.0
"""What is made for Nuke, Houdini, Gaffer and Maya: calls against stand-ins, the line itself, and the Blink kernel.

None of these programs can be run here. Stand-ins record calls; public stubs of their Python say which calls exist.
"""

from __future__ import annotations

import importlib
import re
import shlex
import shutil
import subprocess
import sys
import types
import xml.etree.ElementTree as xml
from pathlib import Path
from unittest import mock

import numpy as np
import OpenImageIO as oiio
import pytest

from oiiotex.engine.core.window import Window
from oiiotex.engine.session import Session
from oiiotex.synthesis.exemplar.presets import PRESETS
from tests import pictures
from tests.conftest import save
from tests.studio.test_wang_renderers import TILE, endless, folder  # noqa: F401

HOST = Path(__file__).parents[2] / "hosts" / "dcc"
MAPS = {"color": "a_color.png", "normal": "a_normal.png", "roughness": "a_rough.png", "height": "a_height.exr"}
NODES = {  # of Nuke, and knobs of these
    "Read": {"file", "raw", "label"}, "Tile": {"rows", "columns"}, "Expression": {"expr0", "expr1", "label"},
    "STMap": {"channels", "uv", "filter"}, "Cryptomatte": set(), "Constant": {"format", "channels"},
    "BlinkScript": set(),
}  # fmt: skip


@pytest.fixture
def host(monkeypatch):
    """Imports a module of the folder with stand-ins for a program's modules."""
    monkeypatch.syspath_prepend(str(HOST))

    def module(name, **programs):
        for program, stand_in in programs.items():
            monkeypatch.setitem(sys.modules, program, stand_in)
        for known in ("oiiotex_line", name):
            monkeypatch.delitem(sys.modules, known, raising=False)
        return importlib.import_module(name)

    return module


def test_the_line_makes_the_files(host, tmp_path, monkeypatch):
    line = host("oiiotex_line")
    save(pictures.bricks(32, 40, seed=1), tmp_path / "a_color.png", space="srgb_rec709_scene")
    save(np.full((32, 40, 3), (0.5, 0.5, 1.0)), tmp_path / "a_normal.png")
    monkeypatch.setenv("OIIOTEX", str(Path(sys.executable).with_name("oiiotex")))
    monkeypatch.setenv("PYTHONHOME", "/of/another/program")
    maps = {"normal": tmp_path / "a_normal.png", "color": tmp_path / "a_color.png"}
    for kind in ("exr", "tx"):
        words, files = line.tile_line(maps, tmp_path / "tile", kind=kind, size="40x32", iterations=2)
        line.run(words)
        made = {role: oiio.ImageBuf(path) for role, path in files.items()}
        spaces = {role: one.spec().get_string_attribute("oiio:ColorSpace") for role, one in made.items()}
        if kind == "exr":  # a .tx is a TIFF, which names no space
            assert "709" in spaces["color"] and "709" not in spaces["normal"]
        assert all((one.spec().width, one.spec().height) == (40, 32) for one in made.values())
        assert (made["color"].nmiplevels > 1) == (kind == "tx")
        assert made["normal"].get_pixels(oiio.FLOAT).mean((0, 1)) == pytest.approx((0.5, 0.5, 1), abs=0.01)
    with pytest.raises(RuntimeError, match="sigma=0: expected a number"):
        line.run(line.tile_line(maps, tmp_path / "no", sigma=0)[0])
    monkeypatch.setenv("OIIOTEX", "/nowhere/oiiotex")
    with pytest.raises(RuntimeError, match="set OIIOTEX to the path of oiiotex"):
        line.run(line.tile_line(maps, tmp_path / "no")[0])


def test_roles_are_the_ends_of_names(host):
    line = host("oiiotex_line")
    names = ("wall_BaseColor.png", "x.albedo.tif", "a_rough.png", "a-height.exr", "wall.png", "wall_nrm.png")
    assert [line.role_of(name) for name in names] == ["color", "color", "roughness", "height", None, "normal"]
    words, _ = line.tile_line({"height": "h.exr"}, "out", st="C:/shots/st.exr", seed=3)
    assert words[1:3] == ["h.exr", '--texstationarize:data=1:st="C:/shots/st.exr":seed=3']


@pytest.mark.slow
@pytest.mark.parametrize(("program", "stubs"), [("nuke", "nuke"), ("houdini", "hou"), ("maya", "maya")])
def test_calls_are_those_of_public_stubs(program, stubs, tmp_path):
    if not any(Path(place, f"{stubs}-stubs").exists() for place in sys.path):
        pytest.skip(f"NOT RUN: no stubs of {program} (pip install oiiotex[hosts])")
    script = tmp_path / f"oiiotex_{program}.py"
    for path in HOST.glob("*.py"):
        shutil.copy(path, tmp_path)
    line = [sys.executable, "-m", "mypy", "--config-file=", "--check-untyped-defs", "--cache-dir=cache", script]
    done = subprocess.run(line, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout
    script.write_text(script.read_text().replace("setGenericFlag", "setFlag").replace("connectAttr", "connectAtr"))
    script.write_text(script.read_text().replace("nuke.getFilename", "nuke.getFile"))
    assert "has no attribute" in subprocess.run(line, cwd=tmp_path, capture_output=True, text=True).stdout


# --- Nuke ---


def nuke_nodes(text):
    """Class and knobs of the nodes of a script, in their order; values have no braces or brackets."""
    found, current = [], None
    for number, line in enumerate(text.splitlines(), 1):
        words = shlex.split(line, comments=True)
        if not words:
            continue
        assert "[" not in line and "$" not in line, f"line {number} would be evaluated"
        if words[1:] == ["{"]:
            assert current is None, f"line {number}: a node within a node"
            current = (words[0], {})
        elif words[0] == "addUserKnob":
            assert words[1].startswith("{") and words[-1].endswith("}"), f"line {number}"
            current[1][words[2].rstrip("}")] = words[-1].rstrip("}")
        elif words == ["}"]:
            found.append(current)
            current = None
        else:
            assert current is not None and line.startswith(" ") and len(words) == 2, f"line {number}"
            current[1][words[0]] = words[1]
    assert current is None, "the last node has no end"
    return found


def test_the_script_of_nuke_connects_what_it_should():
    stack, inputs = [], {}
    (_, buttons), *nodes = nuke_nodes((HOST / "textures.nk").read_text())
    for name, called in (("tile", "make_tile"), ("labels", "pick_labels"), ("plane", "wang_plane")):
        assert buttons[name] == f"import oiiotex_nuke; oiiotex_nuke.{called}()"
        assert f"def {called}()" in (HOST / "oiiotex_nuke.py").read_text()
    for kind, knobs in nodes:
        assert set(knobs) - {"inputs", "name", "label", "xpos", "ypos"} <= NODES[kind], kind
        count = int(knobs.get("inputs", 1))
        inputs[knobs["name"]] = [stack.pop() for _ in range(count)]  # input 0 is the last one
        stack.append(knobs["name"])
    assert inputs["TileOfPicture"] == ["ReadPicture", "FromTheBottom"]
    assert inputs["FromTheBottom"] == ["ReadCoordinates"]
    assert inputs["RepeatTile"] == ["ReadTile"] and inputs["PickLabels"] == ["ReadLabels"]


class Nuke(types.ModuleType):
    """Records nodes."""

    def __init__(self, values):
        super().__init__("nuke")
        self.made, self.messages = [], []
        self.nodes = types.SimpleNamespace(**{kind: lambda kind=kind, **k: self._node(kind, k) for kind in NODES})
        self.Panel = mock.Mock(spec=["__call__"], return_value=mock.Mock(**{"value.side_effect": values.get}))
        self.message, self.selectedNode = self.messages.append, lambda: "photo"
        self.REPLACE = "frame"
        self.filename = lambda node, of: "/shots/photo.exr" if of == self.REPLACE else "/shots/photo.%04d.exr"
        self.getFilename = lambda title, pattern: "/shots/wall_index.png"
        self.menu = mock.Mock()

    def _node(self, kind, knobs):
        assert set(knobs) - {"inputs"} <= NODES[kind], kind
        self.made.append((kind, knobs))
        return mock.MagicMock(name=kind)


def test_nuke_flips_the_coordinates_and_shows_the_tile(host, monkeypatch):
    nuke = Nuke({"Seed": "7", "Preset": "even", "Color space": "ACEScg"})
    module = host("oiiotex_nuke", nuke=nuke)
    lines = []
    monkeypatch.setattr(module, "run", lines.append)
    module.make_tile()
    line = " ".join(lines[0])
    assert "/shots/photo.exr --iscolorspace ACEScg --texstationarize:st=/shots/photo_tile_st.exr:" in line
    assert "seed=7:preset=even" in line
    _, choices = nuke.Panel.return_value.addEnumerationPulldown.call_args.args
    assert set(choices.split()) == {"automatic", *PRESETS}
    kinds = [kind for kind, _ in nuke.made]
    assert kinds == ["Read", "Tile", "Read", "Expression", "STMap"]
    assert nuke.made[0][1]["file"] in lines[0] and nuke.made[2][1]["raw"]
    assert nuke.made[3][1]["expr1"] == "1 - g" and nuke.made[4][1]["filter"] == "Impulse"
    module.pick_labels()
    assert lines[1][1:] == ["/shots/photo.exr", "--texlabel:cryptomatte=1:onepart=1", "-o", "/shots/photo_labels.exr"]
    module.wang_plane()
    assert [knobs.get("file") for _, knobs in nuke.made[-4:-2]] == ["/shots/wall_color.png", "/shots/wall_index.png"]
    monkeypatch.setattr(module, "run", mock.Mock(side_effect=RuntimeError("no such photo")))
    assert module.make_tile() is None and nuke.messages == ["no such photo"]
    module.menu()
    nuke.filename = lambda node, of: None
    assert module.pick_labels() is None and nuke.messages[1] == "expected a Read node with a file"


BLINK = """
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <vector>
struct int2 { int x, y; };
struct float4 { float x, y, z, w; };
struct Box { int x1, y1, x2, y2; };
struct Pixels {
  std::vector<float4> values; Box bounds; int2 now;
  Pixels(int wide = 0, int high = 0) : values(wide * high), bounds{0, 0, wide, high}, now{0, 0} {}
  float4& operator()(int x, int y) { if (x < 0 || y < 0 || x >= bounds.x2 || y >= bounds.y2) abort();
                                     return values[y * bounds.x2 + x]; }
  float4& operator()() { return (*this)(now.x, now.y); }
};
enum { eRead, eWrite, eAccessPoint, eAccessRandom, eEdgeNone, ePixelWise };
template<int... A> struct Image : Pixels { using Pixels::Pixels; Image& operator=(const Pixels& p)
                                           { Pixels::operator=(p); return *this; } };
template<int> struct ImageComputationKernel {
  virtual void define() {} template<class T> void defineParam(T& p, const char*, T v) { p = v; } };
#define kernel struct
#define param public
#include "wang_plane.blink"
Pixels input() { int w, h; scanf("%d %d", &w, &h); Pixels p(w, h);
                 for (auto& v : p.values) scanf("%f %f %f", &v.x, &v.y, &v.z); return p; }
int main(int, char** words)
{
  WangPlane k; k.atlas = input(); k.cells = input();
  k.plane = k.shown = Pixels(atoi(words[3]), atoi(words[4]));
  k.define(); k.left = atoi(words[1]); k.top = atoi(words[2]);
  for (int y = 0; y < k.shown.bounds.y2; y++) for (int x = 0; x < k.shown.bounds.x2; x++) {
    k.shown.now = {x, y}; k.process({x, y});
    float4 v = k.shown(); printf("%g %g %g\\n", v.x * 255, v.y * 255, v.z * 255); }
}
"""


def test_the_blink_kernel_gives_the_pixels_of_an_endless_texture(folder, tmp_path):  # noqa: F811
    """Compiled as C++, with the few types of Blink that it uses."""
    if shutil.which("c++") is None:
        pytest.skip("NOT RUN: no c++: apt install g++")
    (tmp_path / "main.cpp").write_text(BLINK)
    program = tmp_path / "plane"
    line = ["c++", "-std=c++17", "-fpermissive", "-w", f"-I{HOST}", tmp_path / "main.cpp", "-o", program]
    subprocess.run(line, check=True, timeout=100)
    given = []
    for name in ("color.png", "out/a wall_index.png"):
        image = oiio.ImageBuf(str(folder / name)).get_pixels(oiio.UINT8)[::-1, :, :3] / 255  # from the bottom
        values = " ".join(f"{value:.7f}" for value in image.ravel())
        given.append(f"{image.shape[1]} {image.shape[0]} {values}")
    texture = endless(folder, "color")
    wide, high = 3 * TILE, 2 * TILE
    for left, top in ((0, 0), (-TILE - 5, 4000 + 3)):
        words = [str(n) for n in (left, top, wide, high)]
        done = subprocess.run([program, *words], input=" ".join(given), capture_output=True, text=True, check=True)
        shown = np.array(done.stdout.split(), float).reshape(high, wide, 3)[::-1]
        wanted = texture.tile(0, Window.sized(left, top, wide, high), Session())
        np.testing.assert_allclose(shown, wanted, atol=0.01)


# --- Houdini ---


class Hou:
    """A node that records its children, parameters and connections."""

    def __init__(self, kind="", name=""):
        self.kind, self.name, self.children, self.values, self.inputs = kind, name, [], {}, {}
        self.comment, self.is_material = "", False

    def createNode(self, kind, name=None):
        self.children.append(Hou(kind, name))
        return self.children[-1]

    def setParms(self, values):
        self.values.update(values)

    def setNamedInput(self, name, node, output):
        assert output == "out"
        self.inputs[name] = node

    def setInput(self, number, node):
        self.inputs[number] = node

    def setGenericFlag(self, flag, on):
        self.is_material = flag == "Material" and on

    def setComment(self, text):
        self.comment = text

    def allItems(self):
        return self.children

    def deleteItems(self, items):
        self.children = []

    def layoutChildren(self):
        pass


def test_houdini_builds_a_material(host, monkeypatch):
    network = Hou()
    hou = mock.MagicMock(spec=["node", "ui", "text", "fileType", "nodeFlag", "severityType", "InterruptableOperation"])
    hou.node.return_value, hou.nodeFlag.Material = network, "Material"
    hou.text.variableName.side_effect = hou.text.expandString.side_effect = lambda text: text
    hou.ui.selectFile.return_value = " ; ".join(f"/m/{name}" for name in MAPS.values())
    hou.InterruptableOperation.return_value.__exit__.return_value = False
    module = host("oiiotex_houdini", hou=hou)
    monkeypatch.setattr(module, "run", lambda words: None)
    subnet = module.shelf()
    assert subnet.is_material and subnet.comment.startswith("oiiotex /m/a_color.png")
    nodes = {node.name: node for node in subnet.children}
    surface = nodes["surface"]
    assert {name: node.name for name, node in surface.inputs.items()} == {
        "base_color": "color", "normal": "normalmap", "specular_roughness": "roughness",
    }  # fmt: skip
    assert nodes["normalmap"].inputs == {"in": nodes["normal"]}
    assert nodes["displacement"].inputs == {"displacement": nodes["height"]}
    assert nodes["displacement_output"].inputs[0] is nodes["displacement"]
    assert nodes["surface_output"].values["parmtype"] == "surface"
    images = {name: node.values for name, node in nodes.items() if node.kind == "mtlximage"}
    assert images["color"] == {"signature": "color3", "file": "/m/a_tile_color.exr", "filecolorspace": "lin_rec709"}
    assert {images[role]["filecolorspace"] for role in ("normal", "roughness", "height")} == {"Raw"}
    monkeypatch.setattr(module, "run", mock.Mock(side_effect=RuntimeError("too small")))
    assert module.shelf() is None and hou.ui.displayMessage.call_args.args == ("too small",)
    hou.ui.selectFile.return_value = "/m/a.png ; /m/b.png"
    assert module.shelf() is None and "end with different roles" in hou.ui.displayMessage.call_args.args[0]


def test_the_input_names_of_houdini_are_those_of_materialx(host):
    mx = pytest.importorskip("MaterialX", reason="NOT RUN: no MaterialX")
    from oiiotex_studio.materials.documents import loaded_libraries

    surface = loaded_libraries().getNodeDef("ND_standard_surface_surfaceshader")
    kinds = {"color3": "color3", "default": "float", "vector3": "vector3"}
    for name, signature in host("oiiotex_houdini", hou=mock.MagicMock())._INPUTS.values():
        assert surface.getActiveInput(name).getType() == kinds[signature] and isinstance(surface, mx.NodeDef)


def test_the_shelf_calls_the_module():
    shelf = xml.parse(HOST / "oiiotex.shelf").getroot()
    tools = {tool.get("name") for tool in shelf.findall("tool")}
    assert {tool.get("name") for tool in shelf.iter("memberTool")} == tools
    script = shelf.find("tool/script").text
    compile(script, "shelf", "exec")
    assert "oiiotex_houdini.shelf()" in script


# --- Maya ---


def test_maya_builds_a_material(host, monkeypatch):
    cmds = mock.MagicMock(spec=["shadingNode", "sets", "connectAttr", "setAttr", "addAttr", "fileDialog2", "warning"])
    cmds.shadingNode.side_effect = lambda kind, name, **flags: name
    cmds.sets.side_effect = lambda name, **flags: name
    cmds.fileDialog2.return_value = [f"/m/{name}" for name in MAPS.values()]
    maya = types.ModuleType("maya")
    maya.cmds = cmds
    module = host("oiiotex_maya", maya=maya)
    monkeypatch.setattr(module, "run", lambda words: None)
    assert module.make_material(seed=3) == "a_SG"
    links = {tuple(call.args) for call in cmds.connectAttr.call_args_list}
    assert links == {
        ("a_surface.outColor", "a_SG.surfaceShader"), ("a_color.outColor", "a_surface.baseColor"),
        ("a_normal.outColor", "a_normalmap.input"), ("a_normalmap.outValue", "a_surface.normalCamera"),
        ("a_roughness.outColorR", "a_surface.specularRoughness"), ("a_height.outColorR", "a_displacement.displacement"),
        ("a_displacement.displacement", "a_SG.displacementShader"),
    }  # fmt: skip
    values = {call.args[0]: call.args[1] for call in cmds.setAttr.call_args_list}
    assert values["a_color.filename"] == "/m/a_tile_color.tx" and values["a_normal.colorSpace"] == "Raw"
    assert values["a_color.autoTx"] is False and "seed=3" in values["a_SG.oiiotex"]
    cmds.fileDialog2.return_value = ["/m/a.png", "/m/b.png"]
    assert module.make_material() is None and "end with different roles" in cmds.warning.call_args.args[0]


# --- Gaffer ---


def test_gaffer_makes_a_tile_for_each_seed(host):
    plugs = {}

    def node(kind):
        made = mock.MagicMock(name=kind)
        plugs[kind] = {}
        made.__getitem__.side_effect = lambda name: plugs[kind].setdefault(name, mock.MagicMock(name=f"{kind}.{name}"))
        return lambda *args, **given: made

    gaffer = mock.MagicMock(spec=["Box", "IntPlug", "Plug", "ContextVariables", "NameValuePlug", "PlugAlgo"])
    children = {}
    box = gaffer.Box.return_value
    box.__class__ = dict
    gaffer.Box.return_value = children
    dispatch = mock.MagicMock(spec=["SystemCommand", "Wedge"])
    dispatch.SystemCommand.side_effect = node("SystemCommand")
    dispatch.Wedge.side_effect = node("Wedge")
    dispatch.Wedge.Mode.IntRange = 1
    image = mock.MagicMock(spec=["ImageReader"])
    image.ImageReader.side_effect = node("ImageReader")
    module = host("oiiotex_gaffer", Gaffer=gaffer, GafferDispatch=dispatch, GafferImage=image)
    module.tiles("photo.png", "out/tile", seeds=3, preset="even")
    command = plugs["SystemCommand"]["command"].setValue.call_args.args[0]
    replaced = shlex.split(command.replace("${oiiotex:seed}", "2"))
    assert '--texstationarize:seed="2":preset=even' in replaced and replaced[-1] == "out/tile.2_color.exr"
    assert not re.search(r"[{}]", " ".join(replaced))
    read = plugs["ImageReader"]["fileName"].setValue.call_args.args[0]
    assert read.replace("${oiiotex:seed}", "2") == replaced[-1]
    said = {name: plug.setValue.call_args.args[0] for name, plug in plugs["Wedge"].items() if plug.setValue.called}
    assert said == {"variable": "oiiotex:seed", "mode": 1, "intMin": 0, "intMax": 2}
    assert set(children) == {"seed", "command", "wedge", "reader", "chosen"}
