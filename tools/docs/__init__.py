# SPDX-License-Identifier: Apache-2.0
"""What makes the documentation: pages and pictures."""
