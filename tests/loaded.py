# SPDX-License-Identifier: Apache-2.0
"""All that a line may ask for, imported, and the color configs that nearly each loads. No device is opened."""

from __future__ import annotations

import importlib
import os
import pkgutil

import OpenImageIO as oiio

import oiiotex
from oiiotex.engine.color.config import DEFAULT_CONFIG, ColorConfig
from oiiotex.oiiotool.cli.vocabulary import LANGUAGE

LIBRARIES = (
    "OpenImageIO", "PyOpenColorIO", "email.parser", "importlib.resources.readers", "numpy.fft", "numpy.ma",
    "numpy.random", "pyopencl.characterize", "pyopencl.invoker",
)  # fmt: skip
SERVERS = "oiiotex.oiiotool.service."
MODULES = [
    module.name
    for module in pkgutil.walk_packages(oiiotex.__path__, "oiiotex.")
    if not module.name.startswith(SERVERS) and not module.name.endswith("__main__")
]
_before = dict(os.environ)
for name in (*LIBRARIES, *MODULES):
    importlib.import_module(name)
ENVIRONMENT = dict(os.environ.items() - _before.items())  # set by them: pyopencl finds its own files by it
assert LANGUAGE.ops and LANGUAGE.groups  # imports all of their files, and options of the studio if there are any
ColorConfig(DEFAULT_CONFIG).has("sRGB")  # takes 30 ms,
oiio.ColorConfig.default_colorconfig().resolve("sRGB")  # and that of OpenImageIO's writers 20
