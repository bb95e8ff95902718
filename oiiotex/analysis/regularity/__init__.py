# SPDX-License-Identifier: Apache-2.0
"""Periodic structure of a photo, and how synthesis keeps it."""
