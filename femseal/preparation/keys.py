"""Name the keys of a case in errors of functions that only know the names of their own arguments."""

from collections.abc import Iterator
from contextlib import contextmanager

from ..base import InputError

#: Key in the table of a face for each argument of the functions that generate a face, if their names differ.
FACE_KEYS = {"shape": "points"}
#: Key for each argument of the functions that condition a surface.
SURFACE_KEYS = {
    "shortest_wave": "surface.shortest_wave",
    "max_share": "surface.max_undefined",
    "continue_spectrum": "surface.continue_spectrum",
    "shape": "surface.points",
    "spikes": "surface.spikes",
    "order": "surface.detrend",
}


def keys_of_table(table: str, names: str) -> dict[str, str]:
    """Map names of arguments, separated by blanks, to keys of the same names in a table.

    >>> keys_of_table("stochastic", "length breadth")
    {'length': 'stochastic.length', 'breadth': 'stochastic.breadth'}
    """
    return {name: f"{table}.{name}" for name in names.split()}


#: Key for each argument of a scene, of a seal with its tiles, and of a pressure map.
SCENE_KEYS = (
    keys_of_table("contact", "fluid_pressure")
    | keys_of_table("fluid", "inlet_pressure")
    | keys_of_table("face", "patches")
)
SEAL_KEYS = keys_of_table("stochastic", "length breadth") | keys_of_table(
    "seal", "path unit inlet outlet lay centre inner_radius outer_radius field"
)
MAP_KEYS = keys_of_table("load", "map") | keys_of_table(
    "load.map",
    "fractions positions angles path name length_unit pressure_unit points pressure field",
)


@contextmanager
def errors_with_keys(keys: dict[str, str], table: str = "") -> Iterator[None]:
    """Replace names of arguments by keys of a case in an InputError that is raised in the context.

    keys : key for each argument. table : name of the table that contains the keys, if it is not part of them.
    """
    try:
        yield
    except InputError as error:
        in_case = error.with_keys(keys)
        raise (in_case.inside(table) if table else in_case) from error
