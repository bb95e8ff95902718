# SPDX-License-Identifier: Apache-2.0
"""The API for programs built on oiiotex: live page, library, recipes and farm.

Such programs import only `images`, `files`, `lines`, `materials`, `measures`, `painting` and `service`. Filters of
other packages use `oiiotex.plugin`. Other modules may change between versions.
"""
