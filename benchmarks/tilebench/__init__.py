# SPDX-License-Identifier: Apache-2.0
"""A public benchmark of tools that make a photo tile."""
