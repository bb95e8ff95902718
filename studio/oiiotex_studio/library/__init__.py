# SPDX-License-Identifier: Apache-2.0
"""Builds a library of materials from a folder of photos and maps. See README.md."""
