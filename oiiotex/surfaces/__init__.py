# SPDX-License-Identifier: Apache-2.0
"""What surrounds a texture: captured materials, meshes, shots, and charts of results."""
