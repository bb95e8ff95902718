# SPDX-License-Identifier: Apache-2.0
"""The loaded bundle, with a resident process of its own."""

from __future__ import annotations

import contextlib
import os
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from oiiotex.engine.errors import Error
from oiiotex.engine.session import Session
from oiiotex.oiiotool.service.client import connect
from oiiotex.oiiotool.service.settings import ResidentSettings
from tests import pictures
from tests.hosts.openfx.build import built
from tests.hosts.openfx.host import OK, Host, Image, Node

SPACE = "lin_rec709_scene"


@pytest.fixture(scope="session")
def plugin() -> Path:
    """The plugin's file."""
    return built("openfx_plugin")


@pytest.fixture(scope="package")
def resident() -> Iterator[Callable[[], int]]:
    """The id of the resident process that the plugin asks, in a folder of its own."""
    with pytest.MonkeyPatch.context() as patch, tempfile.TemporaryDirectory(prefix="oxf") as folder:
        os.chmod(folder, 0o700)
        patch.setenv("XDG_RUNTIME_DIR", folder)
        settings = ResidentSettings.of(Session(device_name=None))

        def pid() -> int:
            client = connect(settings)
            number = client.hello()["pid"]
            client.close()
            return number

        yield pid
        with contextlib.suppress(Error):
            connect(settings).end()


@pytest.fixture
def host(plugin: Path, resident: Callable[[], int]) -> Iterator[Host]:
    """A host that finds no fault: every property is one of the specification, and every image is released."""
    host = Host(plugin)
    yield host
    assert host.wrong == []
    assert host.taken == 0
    host.unload()


def photo(width: int = 96, height: int = 64, channels: int = 4, seed: int = 1) -> np.ndarray:
    """Bricks with a stain, (height, width, channels) float32; alpha is 1."""
    pixels = pictures.stained(pictures.bricks(height, width, seed=seed)).astype(np.float32)
    return np.concatenate([pixels, np.ones_like(pixels[..., :1])], -1)[..., :channels]


def with_source(host: Host, name: str, pixels: np.ndarray, context: str = "General", **values: object) -> Node:
    """An instance with a source in a known color space, and these values."""
    node = host.instance(name, context)
    node.parameters["colorspace"].set(SPACE)
    for key, value in values.items():
        node.parameters[key].set(*(value if isinstance(value, tuple) else (value,)))
    node.clips["Source"].connect(Image(host, pixels))
    return node


def edited(node: Node, name: str) -> int:
    """Tell the node that a user has changed a parameter, or pressed a button."""
    given = {"OfxPropName": name, "OfxPropType": "OfxTypeParameter", "OfxPropChangeReason": "OfxChangeUserEdited"}
    return node.do("OfxActionInstanceChanged", **given, OfxPropTime=0.0)


def region(node: Node, time: float = 0.0) -> tuple[int, int, int, int]:
    """The region of definition that the node tells."""
    given = {"OfxPropTime": time, "OfxImageEffectPropRenderScale": (1.0, 1.0)}
    status, out = node.ask("OfxImageEffectActionGetRegionOfDefinition", **given)
    assert status == OK, node.messages
    return tuple(map(int, out["OfxImageEffectPropRegionOfDefinition"]))


def rendered(host: Host, node: Node, dtype: str = "float32", channels: int = 4, **layout: object) -> np.ndarray:
    """The whole region of a node, the top row first."""
    left, bottom, right, top = region(node)
    empty = np.full((top - bottom, right - left, channels), 7, dtype)
    out = Image(host, empty, (left, bottom), **layout)
    assert host.render(node, (left, bottom, right, top), out) == OK, node.messages
    assert node.messages == [] and out.guarded()
    return out.rows()
