# SPDX-License-Identifier: Apache-2.0
"""Multiscale synthesis (HRRG08)."""
