# SPDX-License-Identifier: Apache-2.0
"""Analysis: what a photo shows. Superpixels, labels, dominant texture, stationarity, drift, regularity."""
