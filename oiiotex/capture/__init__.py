# SPDX-License-Identifier: Apache-2.0
"""Photos as material: seen from the front, what their shading says of relief, and what a renderer will not like."""
