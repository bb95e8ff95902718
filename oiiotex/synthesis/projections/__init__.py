# SPDX-License-Identifier: Apache-2.0
"""Projections that make an image stationary: MJH17 section 4.3."""
