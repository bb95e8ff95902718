# SPDX-License-Identifier: Apache-2.0
"""The resident process: one device, warm kernels and analyses, jobs with priority, results as windows."""
