# SPDX-License-Identifier: Apache-2.0
"""The words of a command line: options, steps, expressions, control flow, frame sequences."""
