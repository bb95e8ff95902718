# SPDX-License-Identifier: Apache-2.0
"""Lines spread over machines by schedulers that studios have. See README.md."""
