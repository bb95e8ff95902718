# SPDX-License-Identifier: Apache-2.0
"""Multi-scale label maps (LSA16 sections 4 and 6)."""
