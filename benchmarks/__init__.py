# SPDX-License-Identifier: Apache-2.0
"""Speed and quality, as ratios against peers and bounds."""
