"""Links of the pages that leave ``docs/``: the site has no such pages, so it names the files instead.

``mkdocs.yml`` calls ``on_page_markdown`` for every page. In the repository the links work as they stand.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any, Final

DOCS: Final = Path(__file__).resolve().parent
_LINK: Final = re.compile(r"(?<!!)\[([^\]]+)\]\((?!https?:|#|mailto:)([^)#\s]+)(?:#[^)]*)?\)")


def named(markdown: str, page: Path) -> str:
    """The text of a page with links to files beside ``docs/`` replaced by what they are called."""

    def name(found: re.Match[str]) -> str:
        target = (page.parent / found[2]).resolve()
        if target.is_relative_to(DOCS) or not target.exists():
            return found[0]
        path = target.relative_to(DOCS.parent).as_posix()
        return found[1] if path in found[1] else f"{found[1]} (`{path}`)"

    return _LINK.sub(name, markdown)


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """What mkdocs calls."""
    return named(markdown, Path(page.file.abs_src_path))
