# SPDX-License-Identifier: Apache-2.0
"""Fills of moving shots."""
