# SPDX-License-Identifier: Apache-2.0
"""What a material is to people and to other programs: names, pictures, documents. See README.md."""
