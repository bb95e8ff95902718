# SPDX-License-Identifier: Apache-2.0
"""The pages of the docs hold together: links and anchors resolve, long pages have headings, every how-to is listed."""

from __future__ import annotations

import re
from pathlib import Path

import OpenImageIO as oiio
import pytest

from tools.docs.pictures.gallery import FOLDER, MOST_BYTES, SIDE, entries

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
PAGES = sorted(
    [
        *ROOT.glob("*.md"),
        *DOCS.rglob("*.md"),
        *ROOT.glob("benchmarks/**/*.md"),
        *ROOT.glob("oiiotex/**/README.md"),
        *ROOT.glob("studio/**/README.md"),
    ]
)
LONG = 150  # lines: some three screens


def name(page: Path) -> str:
    return str(page.relative_to(ROOT))


def prose(page: Path) -> str:
    """The page without its blocks of code."""
    return re.sub(r"^( *)```.*?^\1```", "", page.read_text(), flags=re.DOTALL | re.MULTILINE)


def anchors(page: Path) -> set[str]:
    """Of its headings, as GitHub makes them."""
    headings = re.findall(r"^#+ (.+)$", prose(page), re.MULTILINE)
    return {re.sub(r"[^\w -]", "", heading.lower()).replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_every_link_leads_somewhere(page):
    broken = []
    for link in re.findall(r"\]\((?!http)([^)\s]+)\)", prose(page)):
        file, _, heading = link.partition("#")
        target = page.parent / file if file else page
        if not target.exists() or (heading and target.suffix == ".md" and heading not in anchors(target)):
            broken.append(link)
    assert broken == []


@pytest.mark.parametrize("page", sorted(DOCS.rglob("*.md")), ids=name)
def test_a_long_page_has_headings(page):
    """The site makes a table of contents of them."""
    if len(page.read_text().splitlines()) > LONG:
        assert len(re.findall(r"^## ", prose(page), re.MULTILINE)) >= 3


def test_every_how_to_is_in_the_table_by_problem():
    folder = DOCS / "how-to"
    listed = set(re.findall(r"\]\(([\w-]+\.md)\)", (folder / "index.md").read_text()))
    assert {page.name for page in folder.glob("*.md")} - {"index.md"} == listed


@pytest.mark.parametrize(
    ("word", "page"),
    [
        ("watermark", "how-to/keep-or-remove-objects.md"), ("inpaint", "how-to/keep-or-remove-objects.md"),
        ("upscale", "how-to/large-images.md"), ("delight", "how-to/stains-and-gradients.md"),
        ("seamless", "how-to/blobs-and-repetition.md"), ("Substance", "explanation/comparison.md"),
        ("offline", "start/install.md"), ("uninstall", "start/install.md"),
        ("rectangle", "how-to/keep-or-remove-objects.md"),
    ],
)  # fmt: skip
def test_search_finds_the_words_of_users(word, page):
    """The site's search indexes the text of all pages that are not excluded (tools/docs/site.py)."""
    assert re.search(rf"\b{word}\b", prose(DOCS / page), re.IGNORECASE)


def test_every_picture_that_a_page_shows_is_described():
    bare = {name(page) for page in DOCS.rglob("*.md") if re.search(r"!\[\s*\]\(", page.read_text())}
    assert bare == set()


# --- the gallery: every entry has a line, a sentence and a small picture ---


def test_there_are_24_entries_and_no_other_pictures():
    found = [picture for picture, _ in entries()]
    assert len(found) == 24 and set(found) == {path.name for path in FOLDER.glob("gallery_*")}
    assert (FOLDER.parent / "gallery.md").read_text().count("\n### ") == 24


@pytest.mark.parametrize("picture", [picture for picture, _ in entries()])
def test_a_picture_shows_photo_and_tile_and_is_small(picture):
    assert (FOLDER / picture).stat().st_size <= MOST_BYTES
    spec = oiio.ImageBuf(str(FOLDER / picture)).spec()
    assert SIDE < spec.width <= 2 * SIDE + 8 and spec.height <= SIDE
