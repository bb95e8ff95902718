# SPDX-License-Identifier: Apache-2.0
"""Ops whose pixels depend on pixels at other coordinates: crops, quarter turns, resizing, warps, filters."""
