# SPDX-License-Identifier: Apache-2.0
"""What makes the pictures of README and docs."""
