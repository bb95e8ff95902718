# SPDX-License-Identifier: Apache-2.0
"""Tiles that fit each other, and planes of them."""
