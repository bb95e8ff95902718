# SPDX-License-Identifier: Apache-2.0
"""The browser page of --texlive: tune, paint and zoom a photo. A command reproduces every pixel."""
