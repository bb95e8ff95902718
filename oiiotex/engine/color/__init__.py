# SPDX-License-Identifier: Apache-2.0
"""Color spaces, CIE Lab, and the integer grid of Lab."""
