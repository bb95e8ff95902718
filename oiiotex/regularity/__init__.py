# SPDX-License-Identifier: Apache-2.0
"""What repeats in a photo at equal distances, and how synthesis keeps it."""
