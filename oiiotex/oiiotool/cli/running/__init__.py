# SPDX-License-Identifier: Apache-2.0
"""A command line, run: frames, processes, farms, signals, progress."""
