# SPDX-License-Identifier: Apache-2.0
"""Programs that make the pictures of README and docs."""
