# SPDX-License-Identifier: Apache-2.0
"""Smooth drift of light, color and contrast: its field, and how it is removed."""
