# SPDX-License-Identifier: Apache-2.0
"""The resident process: one device, warm kernels, cached analysis, prioritized jobs, windowed results."""
