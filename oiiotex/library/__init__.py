# SPDX-License-Identifier: Apache-2.0
"""A folder of photos and maps becomes a library of materials. See README.md."""
