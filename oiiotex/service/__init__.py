# SPDX-License-Identifier: Apache-2.0
"""The resident process: one device, warm kernels and analyzes, jobs with priority, results as windows."""
