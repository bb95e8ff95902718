# SPDX-License-Identifier: Apache-2.0
"""The resident process: one device, warm kernels, cached analysis, prioritized jobs, windowed results."""

import os
import socket

from ...engine.errors import Error

if not hasattr(os, "memfd_create") or not hasattr(socket, "SO_PEERCRED"):
    raise Error("the resident process (--texlive, hosts, plugins) requires Linux: run command lines instead")
