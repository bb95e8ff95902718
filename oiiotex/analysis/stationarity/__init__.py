# SPDX-License-Identifier: Apache-2.0
"""Measures of stationarity (MJH17 section 3) and of results."""
