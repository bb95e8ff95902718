# SPDX-License-Identifier: Apache-2.0
"""Kernels compared with numba loops that do the same work."""
