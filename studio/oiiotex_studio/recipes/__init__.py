# SPDX-License-Identifier: Apache-2.0
"""Finds materials in a folder of photos by file names, and expands a recipe's lines for each. See README.md."""
