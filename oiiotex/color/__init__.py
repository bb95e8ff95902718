# SPDX-License-Identifier: Apache-2.0
"""Colour spaces, CIE Lab, and the integer grid of Lab."""
