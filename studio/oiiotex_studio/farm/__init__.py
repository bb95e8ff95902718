# SPDX-License-Identifier: Apache-2.0
"""Distributes command lines over machines with existing schedulers. See README.md."""
