# SPDX-License-Identifier: Apache-2.0
"""Photos as material: rectification, relief from shading, and checks of a material's maps."""
