"""What MkDocs calls while it builds the documentation site (`hooks` in mkdocs.yml)."""

from typing import Any

DECISION_BOOST = 0.1
"""Weight of decision records in the search, relative to other pages: they explain why, readers ask how."""


def on_page_markdown(markdown: str, *, page: Any, **_: Any) -> str:
    """Let the search find decision records last."""
    if page.file.src_uri.startswith("decisions/"):
        page.meta["search"] = {"boost": DECISION_BOOST}
    return markdown
