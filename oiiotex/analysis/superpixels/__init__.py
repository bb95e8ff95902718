# SPDX-License-Identifier: Apache-2.0
"""Superpixels and their hierarchy (LSA16 section 3)."""
