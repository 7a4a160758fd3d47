"""A web page as tests read it."""

from html.parser import HTMLParser
from typing import Any

VOID = {"meta", "img", "br", "link", "input"}


class Reader(HTMLParser):
    """Elements, texts and cells of a page; anything left open or closed twice is a fault."""

    def __init__(self, page: str) -> None:
        """Read at once."""
        super().__init__()
        self.open: list[str] = []
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.texts: list[tuple[str, str]] = []
        self.rows: list[list[str]] = []
        self.feed(page)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)
        if tag == "tr":
            self.rows.append([])
        if tag in ("td", "th"):
            self.rows[-1].append("")

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.texts.append((self.open[-1] if self.open else "", data))
        if {"td", "th"} & {*self.open}:
            self.rows[-1][-1] += data

    def within(self, tag: str) -> list[str]:
        """The texts directly in such elements."""
        return [text.strip() for inside, text in self.texts if inside == tag]

    def having(self, name: str) -> list[dict[str, Any]]:
        """The attributes of every element that has that one."""
        return [attributes for _, attributes in self.tags if attributes.get(name)]
