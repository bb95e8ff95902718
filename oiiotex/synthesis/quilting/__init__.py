# SPDX-License-Identifier: Apache-2.0
"""Image quilting (LSA16 section 6)."""
