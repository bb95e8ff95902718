# SPDX-License-Identifier: Apache-2.0
"""The stack of images, and the options that move, name and look through it."""
