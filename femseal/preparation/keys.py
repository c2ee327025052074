"""Replace names of arguments by keys of a case in errors of functions that are called with values of a case."""

from collections.abc import Iterator
from contextlib import contextmanager

from ..base import InputError

#: Arguments of the functions that generate a face, by their key in its table.
FACE_KEYS = {"shape": "points"}
#: Arguments of the functions that condition a surface, by their key.
SURFACE_KEYS = {
    "shortest_wave": "surface.shortest_wave",
    "max_share": "surface.max_undefined",
    "continue_spectrum": "surface.continue_spectrum",
    "shape": "surface.points",
    "spikes": "surface.spikes",
    "order": "surface.detrend",
}


def keys_of_table(table: str, names: str) -> dict[str, str]:
    """Map names of arguments, separated by blanks, to keys with the same name in a table.

    >>> keys_of_table("stochastic", "length breadth")
    {'length': 'stochastic.length', 'breadth': 'stochastic.breadth'}
    """
    return {name: f"{table}.{name}" for name in names.split()}


#: Arguments of a scene, of a seal with its tiles, and of a map of the pressure, by their key.
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
    """Raise an InputError that names keys of a case, in a table if that is given, in place of arguments."""
    try:
        yield
    except InputError as error:
        in_case = error.with_keys(keys)
        raise (in_case.inside(table) if table else in_case) from error
