# SPDX-License-Identifier: Apache-2.0
"""File names and texts that Nuke and Houdini would evaluate, against stand-ins that evaluate as they do."""

from __future__ import annotations

import re
from unittest import mock

import pytest

from tests.hosts.test_dcc import Nuke, host  # noqa: F401

EVALUATED = ("a[python nuke.scriptClear()].exr", "a$HOME.exr", "a`ls`.exr", "a].exr", "a{b}.exr", 'a"b.exr', "a\\b.exr")


def tcl(text):
    """What Nuke would show for a text of a knob, which it evaluates as Tcl does: commands and variables are `!`."""
    return re.sub(r"\\(.)|\[[^\]]*\]|\$\w+", lambda match: match[1] or "!", text)


def test_nuke_evaluates_no_file_name(host, monkeypatch):  # noqa: F811
    assert tcl("a[exit]b$c\\[d\\]") == "a!b![d]"
    for name in EVALUATED:
        nuke = Nuke({"Seed": "7", "Preset": "even", "Color space": "ACEScg"})
        nuke.filename, nuke.getFilename = lambda node, of, name=name: name, lambda *_, name=name: name
        module = host("oiiotex_nuke", nuke=nuke)
        monkeypatch.setattr(module, "run", lambda words: pytest.fail("a line was run"))
        assert module.make_tile() is None and module.pick_labels() is None and module.wang_plane() is None
        assert nuke.made == [] and len(nuke.messages) == 3
        assert all("would be evaluated here; rename" in message for message in nuke.messages)
        with pytest.raises(RuntimeError, match="would be evaluated"):
            module.apply_coordinates("photo", name)


def test_nuke_shows_what_a_user_typed(host, monkeypatch):  # noqa: F811
    nuke = Nuke({"Seed": "[exit]", "Preset": "even", "Color space": "$a {b} \\"})
    module = host("oiiotex_nuke", nuke=nuke)
    lines = []
    monkeypatch.setattr(module, "run", lines.append)
    module.make_tile()
    assert tcl(nuke.made[0][1]["label"]) == "\n".join(lines[0])


def test_houdini_expands_no_file_name(host, monkeypatch):  # noqa: F811
    ran = []

    def expanded(text):
        ran.extend(re.findall("`.*?`", text))
        return text.replace("$HIP", "/shots").replace("$ODD", "/m/`rm`")

    hou = mock.MagicMock()
    hou.text.expandString.side_effect = expanded
    hou.InterruptableOperation.return_value.__exit__.return_value = False
    module, lines = host("oiiotex_houdini", hou=hou), []
    monkeypatch.setattr(module, "run", lines.append)
    for name in ("/m/a`rm`.png", "/m/a`.png", "/m/a$F.png", "$ODD/a.png"):
        hou.ui.selectFile.return_value = name
        assert module.shelf() is None and "would be evaluated here" in hou.ui.displayMessage.call_args.args[0]
        with pytest.raises(RuntimeError, match="would be evaluated"):
            module.material({"color": name.replace("$ODD", "`")}, "a")
    assert ran == [] and lines == []
    hou.ui.selectFile.return_value = "$HIP/a.png"
    assert module.shelf() is not None and lines[0][1] == "/shots/a.png"
