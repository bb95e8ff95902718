# SPDX-License-Identifier: Apache-2.0
"""What makes the documentation: the demo, pages and pictures."""
