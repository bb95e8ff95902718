# SPDX-License-Identifier: Apache-2.0
"""The gallery: every entry has a line, a sentence and a small picture. test_words.py parses the lines."""

from __future__ import annotations

import OpenImageIO as oiio
import pytest

from tools.docs.pictures.gallery import FOLDER, MOST_BYTES, SIDE, entries


def test_there_are_24_entries_and_no_other_pictures():
    found = [picture for picture, _ in entries()]
    assert len(found) == 24 and set(found) == {path.name for path in FOLDER.glob("gallery_*")}
    assert (FOLDER.parent / "gallery.md").read_text().count("\n### ") == 24


@pytest.mark.parametrize("picture", [picture for picture, _ in entries()])
def test_a_picture_shows_photo_and_tile_and_is_small(picture):
    assert (FOLDER / picture).stat().st_size <= MOST_BYTES
    spec = oiio.ImageBuf(str(FOLDER / picture)).spec()
    assert SIDE < spec.width <= 2 * SIDE + 8 and spec.height <= SIDE
