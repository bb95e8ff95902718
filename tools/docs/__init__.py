# SPDX-License-Identifier: Apache-2.0
"""Programs that make the documentation: pages and pictures."""
