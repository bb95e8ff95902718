# SPDX-License-Identifier: Apache-2.0
"""Whole programs compared with other tools."""
