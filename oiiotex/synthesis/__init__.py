# SPDX-License-Identifier: Apache-2.0
"""Synthesis: new texture from a photo. Tiles, quilts, fills, unbounded planes."""
