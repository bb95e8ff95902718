# SPDX-License-Identifier: Apache-2.0
"""The OCIO config with the CIE Lab working space."""
