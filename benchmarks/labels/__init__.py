# SPDX-License-Identifier: Apache-2.0
"""Label maps against ground truth (LSA16)."""
