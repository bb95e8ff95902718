# SPDX-License-Identifier: Apache-2.0
"""Room Paint of the page: a painting of the photo's labels becomes texture."""
