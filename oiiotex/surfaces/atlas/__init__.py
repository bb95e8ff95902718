# SPDX-License-Identifier: Apache-2.0
"""Texture on the surface of a mesh (LDR09 section 7)."""
