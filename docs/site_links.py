"""What the pages say for a repository's viewer, said for the site: ``mkdocs.yml`` calls ``on_page_markdown`` for every page.

Links that leave ``docs/`` lead nowhere on the site: it names the files instead. A bar in code in a table is escaped for the
repository's viewer; the site's Markdown would show the backslash.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any, Final

DOCS: Final = Path(__file__).resolve().parent
_LINK: Final = re.compile(r"(?<!!)\[([^\]]+)\]\((?!https?:|#|mailto:)([^)#\s]+)(?:#[^)]*)?\)")

_ROW: Final = re.compile(r"^\|.*$", re.MULTILINE)
_CODE: Final = re.compile(r"`[^`\n]+`")


def named(markdown: str, page: Path) -> str:
    """The text of a page with links to files beside ``docs/`` replaced by what they are called."""

    def name(found: re.Match[str]) -> str:
        target = (page.parent / found[2]).resolve()
        if target.is_relative_to(DOCS) or not target.exists():
            return found[0]
        path = target.relative_to(DOCS.parent).as_posix()
        return found[1] if path in found[1] else f"{found[1]} (`{path}`)"

    return _LINK.sub(name, markdown)


def unescaped(markdown: str) -> str:
    """The text of a page whose tables have plain bars in code."""
    return _ROW.sub(lambda row: _CODE.sub(lambda code: code[0].replace("\\|", "|"), row[0]), markdown)


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """What mkdocs calls."""
    return unescaped(named(markdown, Path(page.file.abs_src_path)))
