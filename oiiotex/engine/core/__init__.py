# SPDX-License-Identifier: Apache-2.0
"""Windows, images, parameters, ops: what travels and what is declared."""
