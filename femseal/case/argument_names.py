"""Errors of arguments that name keys of a case instead of arguments."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager

from ..base.errors import InputError

#: Arguments of `topography` by their key in a case.
SURFACE_KEYS = {
    "shortest_wavelength": "surface.shortest_wave",
    "max_share": "surface.max_undefined",
    "continue_spectrum": "surface.continue_spectrum",
    "shape": "surface.points",
    "spikes": "surface.spikes",
    "order": "surface.detrend",
}
FACE_KEYS = {"shape": "points", "height_unit": "height_unit"}


#: Tables of the arguments of seals and drawn windows.
SEAL_TABLES = dict.fromkeys(
    ("path", "unit", "inlet", "outlet", "lay", "centre", "inner_radius", "outer_radius", "field"), "seal"
) | dict.fromkeys(("length", "breadth", "sampler", "pressure", "bounds", "width", "library"), "stochastic")

#: Tables of the arguments of maps of the pressure.
MAP_TABLES = {"map": "load", "sampler": "stochastic"} | dict.fromkeys(
    ("fractions", "positions", "angles", "path", "name", "length_unit", "pressure_unit", "points", "pressure", "field"),
    "load.map",
)


@contextmanager
def with_tables(tables: dict[str, str]) -> Iterator[None]:
    """Raise an InputError with the table of a case before the argument with which it begins."""
    try:
        yield
    except InputError as error:
        table = tables.get(re.split(r"\W", error.what, maxsplit=1)[0])
        raise (error if table is None else error.inside(table)) from None


@contextmanager
def with_keys(keys: dict[str, str], place: str = "") -> Iterator[None]:
    """Raise an InputError with keys instead of names of arguments, after the place of their table if that is given."""
    try:
        yield
    except InputError as error:
        # a name before "=" is that of another value which is proposed
        expected = re.sub(r"\b(\w+)(?==)", lambda name: keys.get(name[1], name[1]), error.expected)
        found = InputError(keys.get(error.what, error.what), error.given, expected)
        raise (found.inside(place) if place else found) from error
