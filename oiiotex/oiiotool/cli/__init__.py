# SPDX-License-Identifier: Apache-2.0
"""The command line: oiiotool's language, with the texture filters as --tex... ops."""
