# SPDX-License-Identifier: Apache-2.0
"""How images and small documents enter and leave."""
