# SPDX-License-Identifier: Apache-2.0
"""Subtextures and clique partitioning (CZF02)."""
