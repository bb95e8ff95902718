# SPDX-License-Identifier: Apache-2.0
"""What all synthesis reads of a photo."""
