# SPDX-License-Identifier: Apache-2.0
"""Graph-cut textures (KSE03, LSA16 section 5.2)."""
