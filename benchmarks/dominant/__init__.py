# SPDX-License-Identifier: Apache-2.0
"""The dominant texture (LDR09)."""
