"""Tables of texts, from which the terminal, notebooks, the report and files take theirs."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from html import escape
from textwrap import fill
from typing import Any

#: Width of the column under the names of groups in the terminal.
_GROUP = 12


@dataclass(frozen=True)
class TextTable:
    """Headings and lines of texts.

    title : above the table; "" for none. heads : of the columns; none for a table of names and values. lines : one
    text for each column. names : number of columns from the left that are names, which are aligned to the left;
    others are numbers, to the right. grouped : whether the first column names groups, each of which has a line of its
    own in the terminal. notes : below the table. wrap : length of a heading in the terminal beyond which it is broken
    between words.
    """

    title: str
    heads: tuple[str, ...]
    lines: tuple[tuple[str, ...], ...]
    names: int = 1
    grouped: bool = False
    notes: tuple[str, ...] = field(default=())
    wrap: int = 0

    @classmethod
    def of_columns(cls, title: str, columns: Iterable[tuple[str, Iterable[str]]], **options: Any) -> TextTable:
        """A table of columns, each a heading and its texts."""
        heads, texts = zip(*columns, strict=True)
        return cls(title, tuple(heads), tuple(zip(*texts, strict=True)), **options)

    def without(self, heads: Sequence[str]) -> TextTable:
        """The table without the columns of some headings."""
        kept = [n for n, head in enumerate(self.heads) if head not in heads]
        lines = tuple(tuple(line[n] for n in kept) for line in self.lines)
        names = sum(n < self.names for n in kept)
        return TextTable(
            self.title, tuple(self.heads[n] for n in kept), lines, names, self.grouped, self.notes, self.wrap
        )

    def __rich__(self) -> Any:
        """The table as `rich.print` shows it."""
        from rich.box import SIMPLE_HEAD
        from rich.markup import escape as plain
        from rich.table import Table

        table = Table(box=SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0), show_header=bool(self.heads))
        table.title, table.title_justify = plain(self.title) or None, "left"
        table.caption, table.caption_justify = plain("\n".join(self.notes)) or None, "left"
        first = 1 if self.grouped else 0
        for n, head in list(enumerate(self.heads or self.lines[0]))[first:]:
            text = fill(head, self.wrap, break_long_words=False) if self.wrap else head
            # names of groups are broken, which leaves the width to the numbers
            grouped = self.grouped and n == first
            table.add_column(
                plain(text) if self.heads else "",
                justify="left" if n < self.names or grouped else "right",
                overflow="fold",
                min_width=_GROUP if grouped else None,
                max_width=_GROUP if grouped else None,
            )
        former = None
        for line in self.lines:
            if self.grouped and line[0] != former:
                table.add_row(plain(line[0]), style="bold")
                former = line[0]
            texts = [plain(text) for text in line[first:]]
            if self.grouped:
                texts[0] = f"{texts[0]:>{_GROUP - 3}}"
            table.add_row(*texts)
        return table

    def __str__(self) -> str:
        """The table as plain text, as wide as it needs."""
        from rich.console import Console

        console = Console(width=1000, color_system=None)
        with console.capture() as capture:
            console.print(self)
        return "\n".join(line.rstrip() for line in capture.get().splitlines())

    def _repr_html_(self) -> str:
        """The table for a notebook."""
        caption = f"<caption>{escape(self.title)}</caption>\n" if self.title else ""
        head = f"<thead><tr>{_cells(self.heads, 'th')}</tr></thead>\n" if self.heads else ""
        body = "\n".join(f"<tr>{_cells(line, 'td')}</tr>" for line in self.lines)
        return f"<table>{caption}{head}<tbody>\n{body}\n</tbody></table>"


def _cells(texts: Iterable[str], tag: str) -> str:
    return "".join(f"<{tag}>{escape(text)}</{tag}>" for text in texts)
