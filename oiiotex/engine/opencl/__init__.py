# SPDX-License-Identifier: Apache-2.0
"""OpenCL: a working runtime, devices, programs, memory."""
