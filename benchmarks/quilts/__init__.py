# SPDX-License-Identifier: Apache-2.0
"""Quilts, cuts and guides."""
