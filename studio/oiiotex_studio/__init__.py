# SPDX-License-Identifier: Apache-2.0
"""oiiotex-studio: the live page, the library, recipes and farms, on the public API of oiiotex."""

__version__ = "0.1.0"
