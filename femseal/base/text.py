"""Results as text: numbers, one line, and tables for the terminal, notebooks, the report and files."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from html import escape
from math import expm1, isfinite, isnan
from textwrap import fill
from types import ModuleType
from typing import Any, ClassVar

import numpy as np

from .lazy_package import displays
from .quantities import as_text, counted, with_its_unit

#: Width of the column under the names of groups in the terminal.
_GROUP = 13


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
    def of_columns(
        cls, title: str, columns: Iterable[tuple[str, Iterable[str]]], **options: Any
    ) -> TextTable:
        """A table of columns, each a heading and its texts."""
        heads, texts = zip(*columns, strict=True)
        return cls(title, tuple(heads), tuple(zip(*texts, strict=True)), **options)

    def without(self, head: str) -> TextTable:
        """The table without the column of numbers of a heading."""
        kept = [n for n, other in enumerate(self.heads) if other != head]
        heads, *lines = (tuple(line[n] for n in kept) for line in (self.heads, *self.lines))
        return replace(self, heads=heads, lines=tuple(lines))

    def __rich__(self) -> Any:
        """The table as `rich.print` shows it."""
        from rich.box import SIMPLE_HEAD
        from rich.console import Group
        from rich.markup import escape as plain
        from rich.table import Table
        from rich.text import Text

        table = Table(
            box=SIMPLE_HEAD,
            pad_edge=False,
            padding=(0, 1, 0, 0),
            show_header=bool(self.heads),
            caption=plain("\n".join(self.notes)) or None,
            caption_justify="left",
        )
        first = int(self.grouped)
        for n, head in list(enumerate(self.heads or self.lines[0]))[first:]:
            text = fill(head, self.wrap, break_long_words=False) if self.wrap else head
            # names of groups are broken, which leaves the width to the numbers
            width = _GROUP if self.grouped and n == first else None
            left = n < self.names or width
            table.add_column(
                plain(text),
                justify="left" if left else "right",
                overflow="fold",
                min_width=width,
                max_width=width,
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
        # above the table, as a title of the table is no wider than it
        return Group(Text(self.title, style="table.title"), table) if self.title else table

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


_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
#: Powers of ten that are written as numbers.
_PLAIN = range(-4, 6)


def rows_of(columns: Mapping[str, Any]) -> list[dict[str, Any]]:
    """A dictionary for each row of columns (rows,), or of one value for all rows, in numbers of Python."""
    values = [np.asarray(column) for column in columns.values()]
    lines = zip(*(column.tolist() for column in np.broadcast_arrays(*values)), strict=True)
    return [dict(zip(columns, line, strict=True)) for line in lines]


def comma_separated(rows: Sequence[dict[str, Any]]) -> str:
    """Rows, at least one, as comma-separated values with one line of column names; empty where there is no number.

    Texts that a spreadsheet would take for a formula begin with an apostrophe.
    """
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(map(_plain_cell, rows[0]))
    writer.writerows([_plain_cell(row.get(name, "")) for name in rows[0]] for row in rows)
    return stream.getvalue()


def _plain_cell(value: Any) -> Any:
    """A cell that no spreadsheet computes: only numbers begin with + or -, and no text with = or @.

    >>> _plain_cell("=1+2"), _plain_cell("-2 um"), _plain_cell("-2.5"), _plain_cell(-2.5)
    ("'=1+2", "'-2 um", '-2.5', -2.5)
    """
    if not isinstance(value, str) or not value.startswith(("=", "+", "-", "@", "\t", "\r")):
        return value
    try:
        float(value)
    except ValueError:
        return f"'{value}"
    return value


def number_text(value: float, digits: int = 3, plain: range = _PLAIN) -> str:
    """A number other than 0 as people write it, with a power of ten unless its exponent is in `plain`.

    >>> number_text(16634567.0), number_text(1e-12), number_text(99960.0), number_text(-0.012345, 2)
    ('1.66·10⁷', '10⁻¹²', '100000', '-0.012')
    """
    factor, exponent = f"{value:.{digits - 1}e}".split("e")
    if int(exponent) in plain:
        return f"{float(f'{value:.{digits}g}'):.15g}"
    return f"{float(factor):g}·10{str(int(exponent)).translate(_SUPERSCRIPTS)}".removeprefix("1·")


def duration(seconds: float) -> str:
    """Seconds as text.

    >>> duration(0.01234), duration(75.0), duration(9000.0)
    ('0.012 s', '75 s', '2.5 h')
    """
    if seconds < 600:
        return f"{seconds:.2g} s" if seconds < 99.5 else f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 7200 else f"{seconds / 3600:.2g} h"


def format_deviation(half_width: float, factor: str = "a factor of ") -> str:
    """A distance of ln(x) as a fraction of x, or as a factor where it is large.

    >>> format_deviation(0.0953), format_deviation(1.5), format_deviation(800.0), format_deviation(float("inf"))
    ('10 %', 'a factor of 4.5', 'a factor of more than 10000', 'an unknown factor')
    """
    if not isfinite(half_width):
        return "an unknown factor"
    change = expm1(min(half_width, 10.0))
    if change < 1:
        return f"{100 * change:.2g} %"
    return f"{factor}{1 + change:.2g}" if change < 1e4 else f"{factor}more than 10000"


class Plotted:
    """Base of classes with a picture, which a function in `femseal.plots` draws."""

    __slots__ = ()

    def plot(self, **options: Any) -> Any:
        """Draw this result: a figure of pyplot, which `pyplot.show()` opens and a notebook displays.

        ax : axes to draw into, where the picture has one panel, so that several results go into one figure.
        options : of the function in `femseal.plots` that draws this class.

        Raises InputError: an option that this picture does not have.
        """
        return room("plots").picture(self, **options)


def room(name: str) -> ModuleType:
    """A package of femseal that shows results, such as "plots", imported when it is needed."""
    return displays[name]()


class Shown(Plotted):
    """Base of results, frozen dataclasses whose fields carry `unit` and `long_name` in their metadata.

    Numbers are shown with their unit, arrays by their shape and range, steps and failures by their count; fields with
    repr=False only in the table. `_derived` names properties that are shown first, with their units.
    """

    _derived: ClassVar[dict[str, str]] = {}

    def __repr__(self) -> str:
        facts = (f"{name} {text}" for name, text, _ in self._facts(whole=False))
        return f"{type(self).__name__}({', '.join(facts)})"

    def _repr_html_(self) -> str:
        return TextTable(type(self).__name__, (), tuple(self._facts(whole=True)))._repr_html_()

    def _facts(self, whole: bool) -> list[tuple[str, str, str]]:
        """Name, value as text, meaning."""
        told = [(name, unit, "") for name, unit in self._derived.items()]
        told += [
            (f.name, f.metadata.get("unit", "1"), f.metadata.get("long_name", ""))
            for f in fields(self)  # type: ignore[arg-type]
            if whole or f.repr
        ]
        facts = ((name, value_text(getattr(self, name), unit), what) for name, unit, what in told)
        return [fact for fact in facts if fact[1]]


def value_text(value: Any, unit: str = "1") -> str:
    """A value of a result as short text, "" of None, NaN and an empty tuple; `unit` as in the metadata of its field.

    >>> value_text(2.5e-6, "m"), value_text(np.array([[0.0, 2e8], [np.nan, 1e9]]), "Pa"), value_text(1.5e-18, "m^3")
    ('2.5 µm', '(2 × 2: 0 Pa … 1 GPa)', '1.5e-18 m³')
    """
    if value is None or (isinstance(value, tuple) and not value):
        return ""
    if isinstance(value, np.ndarray):
        return f"({' × '.join(map(str, value.shape))}: {_range_text(value, unit)})"
    if isinstance(value, (bool, np.bool_, str, int, np.integer)):
        return str(value)
    if isinstance(value, (float, np.floating)):
        return "" if isnan(value) else with_its_unit(float(value), unit)
    if isinstance(value, dict):
        return ", ".join(f"{name} {value_text(each, unit)}" for name, each in value.items())
    if isinstance(value, tuple) and hasattr(value[0], "pressure"):
        return f"of {counted(len(value), 'load step')}"
    if isinstance(value, tuple) and isinstance(value[0], str):
        return f"{len(value)}, the first: {value[0]}"
    return repr(value)


def _range_text(values: np.ndarray, unit: str) -> str:
    if values.dtype == bool:
        return f"{100 * values.mean() if values.size else 0:.3g} %"
    finite = values[np.isfinite(values)]
    if finite.size == 0:
        return "undefined"
    low, high = (with_its_unit(float(v), unit) for v in (finite.min(), finite.max()))
    return low if low == high else f"{low} … {high}"


def labelled(label: str, unit: str = "", **options: Any) -> Any:
    """A field of a dataclass with a label and a unit; other options are those of `as_text`."""
    return field(metadata={"unit": unit, "label": label, **options})


class Labelled:
    """Base of dataclasses whose fields carry `unit`, `label`, and `percent` for fractions: a line of text for each.

    A field without a label has no line.
    """

    def __str__(self) -> str:
        metadata = {f.name: f.metadata for f in fields(self) if "label" in f.metadata}  # type: ignore[arg-type]
        width = max(len(m["label"]) for m in metadata.values())
        return "\n".join(
            f"{m['label']:{width}}  {as_text(getattr(self, name), **m)}"
            for name, m in metadata.items()
        )
