# SPDX-License-Identifier: Apache-2.0
"""Materials: file naming, preview images, documents for other programs. See README.md."""
