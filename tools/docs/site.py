# SPDX-License-Identifier: Apache-2.0
"""Hooks of MkDocs.

Folders in the navigation stand for their pages, by the headings of their index. Links that leave docs/ become text: a
site alone cannot open them.
"""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Any

_CODE = re.compile(r"<code>.*?</code>", re.DOTALL)
_CELL = re.compile(r"<td>.*?</td>", re.DOTALL)
_LONG = re.compile(r'(?<=[>\s])[^\s<>"]{20,}(?=[<\s])')
_OPTION = re.compile(r"(?<![\w-])--?[A-Za-z]+(?![^<]*>)")
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
    """The page's text, with links that leave docs/ shown as text.

    Search finds a how-to before the reference, and no papers for councils.
    """
    folder = os.path.dirname(page.file.src_uri)
    if folder == "how-to":
        page.meta["search"] = {"boost": 3}
    if folder == "upstream" or page.file.src_uri == "explanation/openssf.md":  # for councils and maintainers
        page.meta["search"] = {"exclude": True}

    def shown(link: re.Match[str]) -> str:
        text, target = link.groups()
        path = os.path.normpath(os.path.join(folder, target.partition("#")[0]))
        if "://" in target or not path.startswith(".."):
            return link.group()
        name = path.removeprefix("../")
        return f"`{name}`" if text.strip("`") == name else f'<abbr title="{name}, in the checkout">{text}</abbr>'

    return _LINK.sub(shown, markdown)


def on_page_content(html: str, **_: Any) -> str:
    """The page, whose code breaks before an option (--pop), not in it, and in a cell after a comma or equals sign."""

    def kept(block: re.Match[str]) -> str:
        return _OPTION.sub(r'<span class="option">\g<0></span>', block.group())

    def broken(cell: re.Match[str]) -> str:
        return _LONG.sub(lambda word: re.sub("[,=:]", r"\g<0><wbr>", word.group()), cell.group())

    return _CELL.sub(broken, _CODE.sub(kept, html))
