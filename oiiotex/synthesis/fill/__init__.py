# SPDX-License-Identifier: Apache-2.0
"""Replacement of a region of a photo by texture from the same photo or from another one."""
