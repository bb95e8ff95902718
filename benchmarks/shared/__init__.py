# SPDX-License-Identifier: Apache-2.0
"""Photos, ground truth, measures and peers that several topics use."""
