# SPDX-License-Identifier: Apache-2.0
"""Low-frequency variation of light, color and contrast: its measurement and removal."""
