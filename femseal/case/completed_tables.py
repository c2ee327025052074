"""Complete the tables of a case before they are validated.

- The name of a fluid or solid is replaced by its properties.
- Gauge pressures are converted to absolute pressures, and kinematic viscosities to dynamic viscosities.
- Former names of keys are replaced by the present names.
- Tables that are missing, but needed by the chosen methods, are added.

Fluids and solids are completed by the modules `completed_fluids` and `completed_solids`.

Invalid values are left unchanged, because the validation reports them later.
"""

from pathlib import Path
from typing import Any

from ..studies.study_list import DEFAULT_OF_SURFACE, DEFAULT_STUDY, STUDIES
from .completed_fluids import complete_fluids
from .completed_solids import complete_solid
from .hot_hardness import hot_hardness_warnings
from .quantity_types import RawTable

#: Tables that this module completes, or from which it needs keys.
_TABLES = (
    "surface",
    "material",
    "counter_material",
    "fluid",
    "seal",
    "seat",
    "stochastic",
    "output",
)
#: Former keys of [face] and their present names. Former keys are accepted until the next version.
_RENAMED_FACE_KEYS = {"places": "patches"}
#: Warning about a case with an accuracy, but without a method and without a whole seal.
_ACCURACY_OF_FACE = (
    "The leakage is that of the surface alone, not that of whole seals: the case asks for an accuracy, but gives "
    f'neither a method nor the length of the seal, so that the method is "{DEFAULT_OF_SURFACE.name}". For whole seals, '
    f'set method = "{DEFAULT_STUDY.name}" and a length in [{DEFAULT_STUDY.table}]; to keep the surface alone, set '
    f'method = "{DEFAULT_OF_SURFACE.name}"'
)


def complete(data: RawTable) -> RawTable:
    """Complete the tables of a case: make the changes that are listed in the docstring of the module.

    The entry `named_warnings` of the returned data is a tuple of warnings. A warning is added for each renamed key, for
    a method that follows from the accuracy, and for a metal at a high temperature. A warning is also added for each
    property that differs considerably from the property of the named fluid or solid, see `odd_properties`.
    """
    # If the user has given another value where a table is expected, the value is replaced by an empty table here. At
    # the end the value is put back, so that the validation reports the wrong value.
    no_tables = {name: data[name] for name in _TABLES if not isinstance(data.get(name, {}), dict)}
    data = data | {name: {} for name in no_tables}
    warnings: list[str] = []
    data = _with_tables_for_methods(data, warnings)
    data = _with_present_face_keys(data, warnings)
    warnings += hot_hardness_warnings(data)
    data = complete_fluids(data, warnings)
    for table_key in ("material", "counter_material"):
        if table_key in data:
            folder = Path(data.get("folder", "."))
            data[table_key] = complete_solid(data[table_key], table_key, folder, warnings)
    if "face" in data:
        data["face"] = as_tables(data["face"])
    data["named_warnings"] = tuple(warnings)
    return _with_detrending(data) | no_tables


def as_tables(value: Any) -> Any:
    """Return a list of tables; a single table is converted to a list with one table.

    A table without a `kind` gets the kind "file" if it names files by `path` or `patches`.
    """
    tables = [value] if isinstance(value, dict) else value
    if not isinstance(tables, (list, tuple)):
        return value
    return [{"kind": "file", **table} if _names_files(table) else table for table in tables]


def _names_files(table: Any) -> bool:
    return isinstance(table, dict) and ("path" in table or "patches" in table)


def _with_tables_for_methods(data: RawTable, warnings: list[str]) -> RawTable:
    """Add the default method if the case has no method, and each table that a method of the case needs.

    The default method is `DEFAULT_STUDY`. If the case asks for an accuracy but describes only a surface, and not a
    whole seal, the default method is `DEFAULT_OF_SURFACE`, and a warning is added. A case describes only a surface if
    the seal is a strip without a length, that is, if the table of `DEFAULT_STUDY` is missing. The method "auto" of
    earlier versions is replaced by `DEFAULT_OF_SURFACE`.
    """
    is_strip = data.get("seal", {}).get("kind", "rectangular") == "rectangular"
    has_accuracy = data.get("accuracy") is not None
    is_only_face = has_accuracy and is_strip and DEFAULT_STUDY.table not in data
    default_study = DEFAULT_OF_SURFACE if is_only_face else DEFAULT_STUDY
    method = data.get("method", default_study.name)
    if method == "auto":
        method = DEFAULT_OF_SURFACE.name
    if is_only_face and "method" not in data:
        warnings.append(_ACCURACY_OF_FACE)
    compared = data.get("compare", ())
    methods = [method, *(compared if isinstance(compared, list) else ())]
    needed_tables: RawTable = {
        study.table: {} for study in STUDIES.values() if study.table and study.name in methods
    }
    return needed_tables | data | {"method": method}


def _with_present_face_keys(data: RawTable, warnings: list[str]) -> RawTable:
    """Rename former keys of all tables [face] to their present names, and add a warning for each renamed key."""
    faces = data.get("face")
    if isinstance(faces, dict):
        return data | {"face": _with_present_keys(faces, warnings)}
    if isinstance(faces, (list, tuple)):
        return data | {"face": [_with_present_keys(face, warnings) for face in faces]}
    return data


def _with_present_keys(face: Any, warnings: list[str]) -> Any:
    """Rename former keys of a single table [face], and add a warning for each renamed key."""
    if not isinstance(face, dict):
        return face
    table = dict(face)
    for former, present in _RENAMED_FACE_KEYS.items():
        if former in table and present not in table:
            table[present] = table.pop(former)
            warnings.append(
                f"face.{former} has been renamed face.{present}; the former name is accepted until the next version"
            )
    return table


def least_detrend(kind: object) -> int:
    """Return the lowest value of `surface.detrend` that is allowed for a measured surface on a seat of the given kind.

    The value is 0 if the mean has to be removed from the surface, 1 for the mean and the tilt, and 2 if the curvature
    has to be removed as well. The shape of the seat is added to the measured surface later. The measured surface must
    not contain the shape of the seat, because the shape would be counted twice.
    """
    return {"flat": 0, "tilted": 1}.get(str(kind), 2)


def _with_detrending(data: RawTable) -> RawTable:
    """Add `surface.detrend` for a measured surface on a curved seat, unless the case has this key."""
    faces = data.get("face")
    is_measured = isinstance(faces, list) and any(
        isinstance(face, dict) and face.get("kind") == "file" for face in faces
    )
    seat = data.get("seat", {"kind": "flat"})
    order = least_detrend(seat.get("kind"))
    if not is_measured or order < 2:
        return data  # the default removes the tilt anyway
    return data | {"surface": {"detrend": order} | data.get("surface", {})}
