# SPDX-License-Identifier: Apache-2.0
"""The command line: oiiotool's language, OpenImageIO's own ops, and the resident process."""
