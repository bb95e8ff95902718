# SPDX-License-Identifier: Apache-2.0
"""Cast shadows: their borders, their light, and their removal."""
