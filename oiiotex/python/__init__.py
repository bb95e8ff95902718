# SPDX-License-Identifier: Apache-2.0
"""The Python interface: filters as functions, results in notebooks, filters of other packages."""
