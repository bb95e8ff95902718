# SPDX-License-Identifier: Apache-2.0
"""Tiles of one photo: what they keep, lose and repeat."""
