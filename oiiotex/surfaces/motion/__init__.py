# SPDX-License-Identifier: Apache-2.0
"""A surface through a shot: its motion, a clean plate of it, and the plate rendered into frames."""
