"""Tables of a case file made from registered classes, so that a new class gets its table automatically."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import MISSING, fields
from functools import reduce
from operator import or_
from typing import Annotated, Any, Literal, get_type_hints

from pydantic import Field, create_model

from .values import Quantity, Table


def table_of_any(
    registered: dict[str, Any], base: type[Table], more: Callable[[Any], dict[str, Any]] = lambda made: {}
) -> Any:
    """One of the tables of registered dataclasses, by its key `kind`.

    registered : frozen dataclasses by their kind, whose quantities are declared by `base.parameters.parameter`.
    base : base class of their tables.
    more : further keys of the table of each, as pydantic's `create_model` takes them, or others in place of its own.
    """
    tables = [_table(kind, made, base, more(made)) for kind, made in registered.items()]
    if len(tables) == 1:  # a single class needs no discriminator
        return tables[0]
    return Annotated[reduce(or_, tables), Field(discriminator="kind")]


def _table(kind: str, made: Any, base: type[Table], more: dict[str, Any]) -> type[Table]:
    hints = get_type_hints(made)
    keys: dict[str, Any] = {"kind": (Literal[kind], ...)}
    for f in sorted(fields(made), key=lambda f: bool(f.kw_only)):  # the parameters that count most come first
        value = Annotated[hints[f.name], _quantity(f.metadata)] if "allowed" in f.metadata else hints[f.name]
        keys[f.name] = (value, ... if f.default is MISSING else f.default)
    summary = (made.__doc__ or "").split("\n\n")[0]
    table = create_model(f"{made.__name__}Table", __base__=base, __doc__=summary, **keys | more)
    globals().setdefault(table.__name__, table)  # where pickle looks for it: processes get cases
    return table


def _quantity(metadata: Any) -> Quantity:
    above, inclusive = metadata["above"], metadata["inclusive"]
    return Quantity(metadata["unit"], lambda x: x > above or (inclusive and x == above), metadata["allowed"])
