# SPDX-License-Identifier: Apache-2.0
"""The open photos of a server: a document and a hub for each."""
