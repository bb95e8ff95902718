# SPDX-License-Identifier: Apache-2.0
"""Subtextures (CZF02)."""
