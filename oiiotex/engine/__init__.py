# SPDX-License-Identifier: Apache-2.0
"""The engine: images, color, devices, files, and the contract of an op. It knows no texture."""
