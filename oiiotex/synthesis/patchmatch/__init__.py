# SPDX-License-Identifier: Apache-2.0
"""PatchMatch and the projections of MJH17 section 4."""
