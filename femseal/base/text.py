"""Write results as text: as numbers, as lines, and as tables for the terminal, notebooks, the report and files."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from html import escape
from math import expm1, isfinite, isnan
from textwrap import fill
from types import ModuleType
from typing import Any, ClassVar, NamedTuple

import numpy as np

from .lazy_package import displays
from .quantities import as_text, counted, with_its_unit

#: Width of the first column of a grouped table in the terminal [characters].
_GROUP_WIDTH = 13


@dataclass(frozen=True)
class TextTable:
    """A table of texts, which can be shown in a terminal, a notebook or the report.

    Parameters
    ----------
    title : str
        Title above the table, "" for none.
    heads : tuple of str
        Headings of the columns; empty for a table that only lists names and values.
    lines : tuple of tuples of str
        Rows, with one text for each column.
    names : int
        Number of left-aligned columns that contain names. They are followed by right-aligned columns of numbers.
    grouped : bool
        Whether the first column contains the name of a group of rows. The terminal shows the name of each group in a
        separate line above its rows.
    notes : tuple of str
        Notes below the table.
    wrap : int
        Longest line of a heading in the terminal [characters]; longer headings are broken between words. 0: no limit.
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
        """Make a table from pairs of the heading and the texts of each column."""
        heads, texts = zip(*columns, strict=True)
        return cls(title, tuple(heads), tuple(zip(*texts, strict=True)), **options)

    def without(self, head: str) -> TextTable:
        """Return the table without the column that has a given heading."""
        remaining = [n for n, heading in enumerate(self.heads) if heading != head]
        heads = tuple(self.heads[n] for n in remaining)
        lines = tuple(tuple(line[n] for n in remaining) for line in self.lines)
        return replace(self, heads=heads, lines=lines)

    def __rich__(self) -> Any:
        """Return the table in the form that `rich.print` displays."""
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
        self._add_columns(table)
        first_column = int(self.grouped)
        previous_group = None
        for line in self.lines:
            if self.grouped and line[0] != previous_group:
                table.add_row(plain(line[0]), style="bold")
                previous_group = line[0]
            texts = [plain(text) for text in line[first_column:]]
            if self.grouped:
                texts[0] = f"{texts[0]:>{_GROUP_WIDTH - 3}}"
            table.add_row(*texts)
        if not self.title:
            return table
        # the title of a rich table is wrapped at the width of the table, so it is printed above it instead
        return Group(Text(self.title, style="table.title"), table)

    def _add_columns(self, table: Any) -> None:
        """Add the columns with their headings and alignment to a table of rich."""
        from rich.markup import escape as plain

        first_column = int(self.grouped)
        for n, head in enumerate(self.heads or self.lines[0]):
            if n < first_column:
                continue
            text = fill(head, self.wrap, break_long_words=False) if self.wrap else head
            # the names of groups are wrapped, which leaves more width to the numbers
            is_group_column = self.grouped and n == first_column
            width = _GROUP_WIDTH if is_group_column else None
            is_name = n < self.names or is_group_column
            table.add_column(
                plain(text),
                justify="left" if is_name else "right",
                overflow="fold",
                min_width=width,
                max_width=width,
            )

    def __str__(self) -> str:
        """Return the table as plain text; the width of a terminal does not limit the width of the table."""
        from rich.console import Console

        console = Console(width=1000, color_system=None)
        with console.capture() as capture:
            console.print(self)
        return "\n".join(line.rstrip() for line in capture.get().splitlines())

    def _repr_html_(self) -> str:
        """Return the table as HTML for a notebook."""
        caption = f"<caption>{escape(self.title)}</caption>\n" if self.title else ""
        head = f"<thead><tr>{_html_cells(self.heads, 'th')}</tr></thead>\n" if self.heads else ""
        body = "\n".join(f"<tr>{_html_cells(line, 'td')}</tr>" for line in self.lines)
        return f"<table>{caption}{head}<tbody>\n{body}\n</tbody></table>"


def _html_cells(texts: Iterable[str], tag: str) -> str:
    """Enclose each text in an HTML tag."""
    return "".join(f"<{tag}>{escape(text)}</{tag}>" for text in texts)


_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
#: Exponents of ten of the numbers that are written without a power of ten.
_PLAIN_EXPONENTS = range(-4, 6)


def rows_of(columns: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Convert columns to a list of rows. Each row is a dictionary with Python numbers as values.

    A column is an array (rows,), or a single value that all rows share.
    """
    arrays = [np.asarray(column) for column in columns.values()]
    lists = [array.tolist() for array in np.broadcast_arrays(*arrays)]
    return [dict(zip(columns, row, strict=True)) for row in zip(*lists, strict=True)]


def flatten(value: Any, key: str = "") -> dict[str, Any]:
    """Convert nested tables to a single table with dotted keys.

    The elements of a list get separate keys only if the list contains tables.

    >>> flatten({"load": {"loading": [1e6, 2e6]}, "face": [{"kind": "file"}]})
    {'load.loading': [1000000.0, 2000000.0], 'face.0.kind': 'file'}
    """
    if isinstance(value, list) and any(isinstance(item, dict) for item in value):
        value = dict(enumerate(value))
    if not isinstance(value, dict):
        return {key: value}
    flat: dict[str, Any] = {}
    for name, item in value.items():
        flat |= flatten(item, f"{key}.{name}".removeprefix("."))
    return flat


def comma_separated(rows: Sequence[dict[str, Any]]) -> str:
    """Write rows as comma-separated values, after one line with the names of the columns.

    The list must contain at least one row, which determines the names of the columns. A missing value is an empty cell.
    A text that a spreadsheet would interpret as a formula is preceded by an apostrophe.
    """
    names = list(rows[0])
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(map(_without_formula, names))
    for row in rows:
        writer.writerow([_without_formula(row.get(name, "")) for name in names])
    return stream.getvalue()


def _without_formula(value: Any) -> Any:
    """Return the content of a cell in a form that spreadsheet programs do not interpret as a formula.

    If a text begins with a character such as "=", "@", "+" or "-" and is not a number, an apostrophe is put in front.

    >>> _without_formula("=1+2"), _without_formula("-2 um"), _without_formula("-2.5"), _without_formula(-2.5)
    ("'=1+2", "'-2 um", '-2.5', -2.5)
    """
    if not isinstance(value, str) or not value.startswith(("=", "+", "-", "@", "\t", "\r")):
        return value
    try:
        float(value)
    except ValueError:
        return f"'{value}"
    return value


def number_text(value: float, digits: int = 3, plain: range = _PLAIN_EXPONENTS) -> str:
    """Write a number other than 0 as readable text, with a power of ten if it is very large or small.

    Parameters
    ----------
    value : float
        The number.
    digits : int
        Number of significant digits.
    plain : range
        Exponents of ten for which a number is written in plain notation, without a power of ten.

    Examples
    --------
    >>> number_text(16634567.0), number_text(1e-12), number_text(99960.0), number_text(-0.012345, 2)
    ('1.66·10⁷', '10⁻¹²', '100000', '-0.012')
    """
    mantissa, exponent = f"{value:.{digits - 1}e}".split("e")
    if int(exponent) in plain:
        rounded = float(f"{value:.{digits}g}")
        return f"{rounded:.15g}"
    power = str(int(exponent)).translate(_SUPERSCRIPTS)
    return f"{float(mantissa):g}·10{power}".removeprefix("1·")


def duration(seconds: float) -> str:
    """Write a duration in a readable unit.

    Examples
    --------
    >>> duration(0.01234), duration(75.0), duration(9000.0)
    ('0.012 s', '75 s', '2.5 h')
    """
    if seconds < 99.5:
        return f"{seconds:.2g} s"
    if seconds < 600:
        return f"{seconds:.0f} s"
    if seconds < 7200:
        return f"{seconds / 60:.0f} min"
    return f"{seconds / 3600:.2g} h"


def format_deviation(half_width: float, factor: str = "a factor of ") -> str:
    """Write an error of ln(x) as the relative error of x: as a percentage, or as a factor if the error is large.

    Examples
    --------
    >>> format_deviation(0.0953), format_deviation(1.5)
    ('10 %', 'a factor of 4.5')
    >>> format_deviation(800.0), format_deviation(float("inf"))
    ('a factor of more than 10000', 'an unknown factor')
    """
    if not isfinite(half_width):
        return "an unknown factor"
    change = expm1(min(half_width, 10.0))  # the cap avoids an overflow
    if change < 1:
        return f"{100 * change:.2g} %"
    if change < 1e4:
        return f"{factor}{1 + change:.2g}"
    return f"{factor}more than 10000"


class Plotted:
    """Give a class the method `plot`, which calls a function in `femseal.plots`."""

    __slots__ = ()

    def plot(self, **options: Any) -> Any:
        """Draw this result.

        Parameters
        ----------
        **options
            Options of the function in `femseal.plots` that draws results of this class. For a picture with a single
            panel, pass axes as `ax` to combine several results in one figure.

        Returns
        -------
        figure
            A Matplotlib figure, which `pyplot.show()` opens and a notebook displays.

        Raises
        ------
        InputError
            The picture of this class does not have such an option.
        """
        return display_package("plots").picture(self, **options)


def display_package(name: str) -> ModuleType:
    """Import and return one of femseal's display packages: "plots", "results" or "report"."""
    return displays[name]()


class _Fact(NamedTuple):
    """Name of a property or field, its value as text, and its meaning ("" for a property)."""

    name: str
    text: str
    meaning: str


class Shown(Plotted):
    """Give result classes a short representation in the terminal and a table in notebooks.

    A result class is a frozen dataclass. The metadata of each field contain its `unit` and its `long_name`. Numbers are
    shown with their unit, and arrays with their shape and range. Lists of load steps or failures are shown by their
    length. A field with `repr=False` appears in the table, but not in the short representation. The class attribute
    `_derived` contains the names and units of properties that are displayed before the fields.
    """

    _derived: ClassVar[dict[str, str]] = {}

    def __repr__(self) -> str:
        facts = (f"{fact.name} {fact.text}" for fact in self._facts(include_hidden=False))
        return f"{type(self).__name__}({', '.join(facts)})"

    def _repr_html_(self) -> str:
        table = TextTable(type(self).__name__, (), tuple(self._facts(include_hidden=True)))
        return table._repr_html_()

    def _facts(self, include_hidden: bool) -> list[_Fact]:
        """List the properties and fields that have a value.

        include_hidden : whether fields with `repr=False` are included.
        """
        facts = []
        for name, unit in self._derived.items():
            facts.append(_Fact(name, value_text(getattr(self, name), unit), ""))
        for f in fields(self):  # type: ignore[arg-type]
            if include_hidden or f.repr:
                text = value_text(getattr(self, f.name), f.metadata.get("unit", "1"))
                facts.append(_Fact(f.name, text, f.metadata.get("long_name", "")))
        return [fact for fact in facts if fact.text]


def value_text(value: Any, unit: str = "1") -> str:
    """Write a value of a result as short text; None, NaN and an empty tuple give "".

    Examples
    --------
    >>> value_text(2.5e-6, "m"), value_text(np.array([[0.0, 2e8], [np.nan, 1e9]]), "Pa"), value_text(1.5e-18, "m^3")
    ('2.5 µm', '(2 × 2: 0 Pa … 1 GPa)', '1.5e-18 m³')
    """
    if value is None or (isinstance(value, tuple) and not value):
        return ""
    if isinstance(value, np.ndarray):
        shape = " × ".join(map(str, value.shape))
        return f"({shape}: {_range_text(value, unit)})"
    if isinstance(value, (bool, np.bool_, str, int, np.integer)):
        return str(value)
    if isinstance(value, (float, np.floating)):
        return "" if isnan(value) else with_its_unit(float(value), unit)
    if isinstance(value, dict):
        return ", ".join(f"{name} {value_text(item, unit)}" for name, item in value.items())
    if isinstance(value, tuple) and hasattr(value[0], "pressure"):  # load steps
        return f"of {counted(len(value), 'load step')}"
    if isinstance(value, tuple) and isinstance(value[0], str):
        return f"{len(value)}, the first: {value[0]}"
    return repr(value)


def _range_text(values: np.ndarray, unit: str) -> str:
    """Write the range of an array as text, or the percentage of true values of a boolean array."""
    if values.dtype == bool:
        fraction = values.mean() if values.size else 0.0
        return f"{100 * fraction:.3g} %"
    finite = values[np.isfinite(values)]
    if finite.size == 0:
        return "undefined"
    low = with_its_unit(float(finite.min()), unit)
    high = with_its_unit(float(finite.max()), unit)
    return low if low == high else f"{low} … {high}"


def finite_data(data: Any) -> Any:
    """Return a copy of plain data for JSON, in which infinite and undefined numbers are None.

    Examples
    --------
    >>> finite_data({"NaN": [1.0, float("nan"), float("-inf")]})
    {'NaN': [1.0, None, None]}
    """
    # JSON has no infinite or undefined numbers: Python writes them as constants, which are read as None here
    return json.loads(json.dumps(data), parse_constant=lambda _: None)


def labelled(label: str, unit: str = "", **options: Any) -> Any:
    """Declare a field of a dataclass with a label, a unit and options of `as_text`."""
    return field(metadata={"unit": unit, "label": label, **options})


class Labelled:
    """Give a dataclass a text representation with one line for each labelled field; see `labelled`."""

    def __str__(self) -> str:
        return "\n".join(self.lines())

    def lines(self, names: Collection[str] | None = None) -> list[str]:
        """Return the lines of the fields with these names; by default, the lines of all labelled fields."""
        metadata = {f.name: f.metadata for f in fields(self) if "label" in f.metadata}  # type: ignore[arg-type]
        width = max(len(options["label"]) for options in metadata.values())
        lines = []
        for name, options in metadata.items():
            if names is None or name in names:
                value = as_text(getattr(self, name), **options)
                lines.append(f"{options['label']:{width}}  {value}")
        return lines
