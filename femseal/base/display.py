"""Show results in a terminal and in notebooks: as one line, as a table, or as a picture."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import field, fields
from math import isnan
from typing import Any, ClassVar, NamedTuple

import numpy as np

import femseal  # its packages are loaded when a method uses them

from .quantities import as_text, counted, with_its_unit
from .text_table import TextTable


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
        return femseal.plots.picture(self, **options)


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
    """Format a value of a result as short text; None, NaN and an empty tuple give "".

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
    """Format the range of an array as text, or the percentage of true values of a boolean array."""
    if values.dtype == bool:
        fraction = values.mean() if values.size else 0.0
        return f"{100 * fraction:.3g} %"
    finite = values[np.isfinite(values)]
    if finite.size == 0:
        return "undefined"
    low = with_its_unit(float(finite.min()), unit)
    high = with_its_unit(float(finite.max()), unit)
    return low if low == high else f"{low} … {high}"


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
