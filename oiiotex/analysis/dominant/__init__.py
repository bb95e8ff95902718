# SPDX-License-Identifier: Apache-2.0
"""Dominant textures (LDR09)."""
