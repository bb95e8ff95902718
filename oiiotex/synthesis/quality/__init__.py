# SPDX-License-Identifier: Apache-2.0
"""Quality measures of a result: fidelity, seams, copies, sharpness, and the report of them."""
