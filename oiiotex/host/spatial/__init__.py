# SPDX-License-Identifier: Apache-2.0
"""Ops whose pixels follow from others than that at their place: crops, turns, scalings, warps, filters."""
