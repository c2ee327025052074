"""Faults in a case as validators raise them, and errors of arguments, which name keys of the case in their place."""

import re
from collections.abc import Iterator
from contextlib import contextmanager

from pydantic_core import PydanticCustomError

from ..base import InputError, shortened

#: Longest text of what is expected, in characters; a longer one loses its middle.
_LONGEST = 300
#: Fields of a case that are no keys of its file.
INTERNAL = ("folder", "named_warnings")
#: Arguments of `topography` by their key in a case.
SURFACE_KEYS = {
    "shortest_wave": "surface.shortest_wave",
    "max_share": "surface.max_undefined",
    "continue_spectrum": "surface.continue_spectrum",
    "shape": "surface.points",
    "spikes": "surface.spikes",
    "order": "surface.detrend",
}
FACE_KEYS = {"shape": "points", "height_unit": "height_unit"}
#: Tables of the arguments of seals and their tiles.
SEAL_TABLES = dict.fromkeys(
    ("path", "unit", "inlet", "outlet", "lay", "centre", "inner_radius", "outer_radius", "field"),
    "seal",
) | dict.fromkeys(("length", "breadth"), "stochastic")
#: Tables of the arguments of a scene and of how it is solved.
SCENE_TABLES = {
    "fluid_pressure": "contact",
    "inlet_pressure": "fluid",
    "places": "face",
}
#: Tables of the arguments of maps of the pressure.
MAP_TABLES = {"map": "load"} | dict.fromkeys(
    (
        "fractions",
        "positions",
        "angles",
        "path",
        "name",
        "length_unit",
        "pressure_unit",
        "points",
        "pressure",
        "field",
    ),
    "load.map",
)


def fault(what: str, given: object, expected: str) -> PydanticCustomError:
    """Fault of a case that involves several keys, for validators to raise."""
    context = {
        "what": what,
        "given": shortened(given),
        "expected": shortened(expected, _LONGEST),
    }
    return PydanticCustomError("input", "{what}: given {given}, expected {expected}", context)


def refusal(expected: str) -> PydanticCustomError:
    """Fault of the value of one key, for validators to raise."""
    return PydanticCustomError("refusal", "{expected}", {"expected": expected})


@contextmanager
def faults_of(table: str = "") -> Iterator[None]:
    """Errors of what is called inside as faults of a table, of which they name the key; "" if they name it in full."""
    try:
        yield
    except InputError as error:
        raise fault(f"{table}.{error.what}".lstrip("."), error.given, error.expected) from None


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
        # a name before "=" is that of another value which is proposed, numbers in brackets a list of the file
        expected = re.sub(r"\b(\w+)(?==)", lambda name: keys.get(name[1], name[1]), error.expected)
        expected = re.sub(r"=\((.*?)\)", r" = [\1]", expected)
        found = InputError(keys.get(error.what, error.what), error.given, expected)
        raise (found.inside(place) if place else found) from error
