# SPDX-License-Identifier: Apache-2.0
"""What the bundle is: the table of its nodes, what they describe, and what the file needs."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path

import pytest

from oiiotex import filters
from oiiotex.engine.core.parameters import parse_modifiers
from tests.hosts.openfx.build import SOURCE
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


def test_the_file_exports_two_functions_and_needs_no_library_of_ours(plugin: Path):
    if shutil.which("nm") is None or shutil.which("ldd") is None:
        pytest.skip("NOT CHECKED: no nm or ldd: apt install binutils")
    nm = ["nm", "-D", "--format=posix", str(plugin)]
    defined = subprocess.run([*nm, "--defined-only"], capture_output=True, text=True, check=True).stdout
    assert {line.split()[0] for line in defined.splitlines()} == {"OfxGetNumberOfPlugins", "OfxGetPlugin"}
    undefined = subprocess.run([*nm, "--undefined-only"], capture_output=True, text=True, check=True).stdout
    for line in undefined.splitlines():
        name, kind = line.split()[:2]
        assert "@GLIBC_" in name or kind == "w", line  # weak: hooks of profilers
    needed = subprocess.run(["ldd", str(plugin)], capture_output=True, text=True, check=True).stdout
    names = {line.split()[0].rpartition("/")[2].partition(".")[0] for line in needed.splitlines()}
    assert names <= {"linux-vdso", "libc", "libm", "ld-linux-x86-64"}


def test_its_own_code_stays_small():
    files = [path for path in SOURCE.iterdir() if path.suffix in (".cpp", ".h")]
    lines = [line for path in files for line in path.read_text().splitlines()]
    assert sum(bool(line.strip()) and not line.lstrip().startswith("//") for line in lines) <= MOST_LINES
