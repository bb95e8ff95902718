# SPDX-License-Identifier: Apache-2.0
"""What the bundle is: the table of its nodes, what they describe, and what the file needs."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from oiiotex import filters
from oiiotex.engine.core.parameters import parse_modifiers
from tests.hosts.openfx.build import SOURCE, built
from tests.hosts.openfx.host import Host
from tools import openfx

NODES = json.loads((SOURCE / "nodes.json").read_text())["nodes"]
MOST_LINES = 1200  # of C++ that only this plugin has, without blank lines and comments


def test_the_table_is_what_the_declarations_say():
    assert (SOURCE / "nodes.json").read_text() == openfx.text(), "run python -m tools.openfx"


def test_every_value_of_the_table_is_one_of_its_filter():
    for node in NODES:
        op = filters.op_named(node["op"])
        for facts in node["params"]:
            if facts["host"] or facts["type"] not in ("choice", "bool"):
                continue
            for word in facts.get("options", ("0", "1")):
                if word != "automatic":
                    parse_modifiers(op, {facts["name"]: word})


@pytest.mark.parametrize("node", NODES, ids=lambda node: node["name"])
def test_every_node_describes_itself_in_its_contexts(host: Host, node):
    for context in node["contexts"]:
        described = host.described(node["name"], context)
        clips = ["Output", *(i["clip"] for i in node["inputs"] if context != "Filter" or i["clip"] == "Source")]
        assert list(described.clips) == clips
        assert described.properties["OfxPropLabel"] == node["label"]
        assert f"OfxImageEffectContext{context}" in described.properties["OfxImageEffectPropSupportedContexts"]
        parameters = described.parameters
        assert set(parameters) - {"advanced"} == {facts["name"] for facts in node["params"]}
        for facts in node["params"]:
            one = parameters[facts["name"]]
            assert one["OfxParamPropHint"] == facts["help"]
            assert ("OfxParamPropParent" in one.values) is facts["advanced"]
            if "min" in facts:
                least, default, most = (one.values[f"OfxParamProp{key}"][0] for key in ("Min", "Default", "Max"))
                assert least <= default <= most
                shown = one.values["OfxParamPropDisplayMin"][0], one.values["OfxParamPropDisplayMax"][0]
                assert least <= shown[0] < shown[1] <= most
            if "options" in facts:
                assert one["OfxParamPropChoiceOption"] == facts["options"]


def test_it_loads_twice(plugin: Path, host: Host):
    other = Host(plugin)
    assert set(other.plugins) == {node["name"] for node in NODES}
    other.unload()


def symbols(file: Path, which: str) -> list[list[str]]:
    """Symbols as (name, kind, ...)."""
    if shutil.which("nm") is None or shutil.which("ldd") is None:
        pytest.skip("NOT CHECKED: no nm or ldd: apt install binutils")
    line = ["nm", "-D", "--format=posix", f"--{which}-only", str(file)]
    return [line.split() for line in subprocess.check_output(line, text=True).splitlines()]


def needed(file: Path) -> set[str]:
    """Libraries that the file loads."""
    lines = subprocess.check_output(["ldd", str(file)], text=True).splitlines()
    return {line.split()[0].rpartition("/")[2].partition(".")[0] for line in lines}


def test_the_file_exports_two_functions_and_needs_no_library_of_ours(plugin: Path):
    assert {name for name, *_ in symbols(plugin, "defined")} == {"OfxGetNumberOfPlugins", "OfxGetPlugin"}
    for name, kind, *_ in symbols(plugin, "undefined"):
        assert "@GLIBC_" in name or kind == "w", name  # weak: hooks of profilers
    assert needed(plugin) <= {"linux-vdso", "libc", "libm", "ld-linux-x86-64"}


@pytest.mark.slow
def test_the_file_of_the_wheel_needs_glibc_2_28():
    """As `make openfx-wheel` builds it; older systems have threads and dl in libraries of their own."""
    pytest.importorskip("ziglang", reason="NOT BUILT: no ziglang (pip install oiiotex[linker])")
    zig = f"{sys.executable} -m ziglang c++ -target x86_64-linux-gnu.2.28"
    assert zig.partition(" ")[2] in (SOURCE.parents[1] / "Makefile").read_text()
    file = built("openfx_zig", compiler=zig)
    assert {name for name, *_ in symbols(file, "defined")} == {"OfxGetNumberOfPlugins", "OfxGetPlugin"}
    versions = [re.search(r"@GLIBC_(\d+)\.(\d+)", name) for name, *_ in symbols(file, "undefined")]
    assert max((int(v[1]), int(v[2])) for v in versions if v) <= (2, 28)
    assert needed(file) <= {"linux-vdso", "libc", "libm", "libpthread", "libdl", "ld-linux-x86-64"}
    assert ".symtab" not in subprocess.check_output(["readelf", "-S", str(file)], text=True)  # stripped


def test_its_own_code_stays_small():
    files = [path for path in SOURCE.iterdir() if path.suffix in (".cpp", ".h")]
    lines = [line for path in files for line in path.read_text().splitlines()]
    assert sum(bool(line.strip()) and not line.lstrip().startswith("//") for line in lines) <= MOST_LINES
