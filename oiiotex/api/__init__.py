# SPDX-License-Identifier: Apache-2.0
"""The public surface for programs that are built on oiiotex: its page, its library, its recipes, its farms.

`images`, `files`, `lines`, `materials`, `painting` and `service` name what such a program may use, wherever it lies
inside; filters of other packages use `oiiotex.plugin`. Other modules may change from one version to the next.
"""
