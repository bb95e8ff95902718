# SPDX-License-Identifier: Apache-2.0
"""Hooks of MkDocs.

Folders in the navigation stand for their pages, by the headings of their index. Links that leave docs/ become names: a site alone cannot open them.
"""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Any

_LINK = re.compile(r"(?<!!)\[([^\]]*)\]\(([^)\s]+)\)")


def on_config(config: Any) -> None:
    """Fill in the pages of folders."""
    config.nav = _filled(config.nav, Path(config.docs_dir))


def _filled(entry: Any, docs: Path) -> Any:
    if isinstance(entry, list):
        return [_filled(one, docs) for one in entry]
    if isinstance(entry, dict):
        return {title: _filled(value, docs) for title, value in entry.items()}
    if not entry.endswith("/"):
        return entry
    groups = _groups(docs / entry / "index.md", entry)
    if groups:
        return groups
    pages = sorted((docs / entry).glob("*.md"), key=lambda page: (page.name != "index.md", page.read_text().lower()))
    return [str(page.relative_to(docs)) for page in pages]


def _groups(index: Path, folder: str) -> list[Any]:
    """The pages of a folder whose index lists them under headings: [index, {heading: pages}, ...]."""
    sections = index.read_text().split("\n## ")[1:] if index.exists() else []
    linked = [(one.partition("\n")[0], re.findall(r"\]\(([\w-]+\.md)\)", one)) for one in sections]
    groups = [{heading: [folder + page for page in dict.fromkeys(pages)]} for heading, pages in linked if pages]
    return [folder + index.name, *groups] if groups else []


def on_page_markdown(markdown: str, *, page: Any, **_: Any) -> str:
    """The page's text, with links that leave docs/ shown as text and path; a how-to is found before the reference."""
    folder = os.path.dirname(page.file.src_uri)
    if folder == "how-to":
        page.meta["search"] = {"boost": 3}

    def shown(link: re.Match[str]) -> str:
        text, target = link.groups()
        path = os.path.normpath(os.path.join(folder, target.partition("#")[0]))
        if "://" in target or not path.startswith(".."):
            return link.group()
        name = f"`{path.removeprefix('../')}`"
        return name if text.strip("`") == name.strip("`") else f"{text} ({name})"

    return _LINK.sub(shown, markdown)
