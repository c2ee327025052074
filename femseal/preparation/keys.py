"""Replace names of function arguments in error messages by keys of the case.

Functions of the package raise errors with the names of their own arguments, such as "shape". The user of a case must
instead see the key of the case, such as "face.points".
"""

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
    """Return, for each argument, the dotted key of the case that has the same name.

    table : name of the table of the case that contains the keys.
    names : names of the arguments, separated by spaces.

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
    """Replace the name of the argument by the key of the case in an InputError that is raised in the `with` block.

    keys : dotted key of the case for each argument name.
    table : name of the table of the case to which the keys in `keys` are relative; "" for complete keys.
    """
    try:
        yield
    except InputError as error:
        error_in_case = error.with_keys(keys)
        if table:
            error_in_case = error_in_case.inside(table)
        raise error_in_case from error
