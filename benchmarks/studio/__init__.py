# SPDX-License-Identifier: Apache-2.0
"""The page, the library and the farm."""
