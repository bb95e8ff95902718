# SPDX-License-Identifier: Apache-2.0
"""Photos to materials, meshes, shots and charts: what surrounds a texture."""
