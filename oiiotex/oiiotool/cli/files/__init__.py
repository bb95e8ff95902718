# SPDX-License-Identifier: Apache-2.0
"""Options that read and write images, and those that show them in another program."""
