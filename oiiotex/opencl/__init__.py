# SPDX-License-Identifier: Apache-2.0
"""OpenCL: a runtime that works here, devices, programs, memory."""
