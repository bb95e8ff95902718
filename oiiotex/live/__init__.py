# SPDX-License-Identifier: Apache-2.0
"""The page: a photo tuned, zoomed into and painted with in a browser, every pixel reproducible by a line."""
