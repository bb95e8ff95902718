# SPDX-License-Identifier: Apache-2.0
"""Synthesis at any scale (HRRG08)."""
