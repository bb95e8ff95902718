# SPDX-License-Identifier: Apache-2.0
"""Options that print: metadata, statistics, comparisons, help, versions, devices."""
