# SPDX-License-Identifier: Apache-2.0
"""What is to be made of a folder of photos: materials found by names, lines of a recipe for each. See README.md."""
