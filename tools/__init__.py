# SPDX-License-Identifier: Apache-2.0
"""Programs of this checkout: the demo and the documentation."""
