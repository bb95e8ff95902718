# SPDX-License-Identifier: Apache-2.0
"""Tiles of one photo: texture kept and lost, and repetition."""
