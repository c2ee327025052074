"""Declare the fields of results: name, unit, meaning, dimensions and column heading.

Each field is declared once. Its name and unit are taken from this declaration everywhere: in the dataset and its netCDF
file, in files for ParaView, in tables and in pictures. A result class declares its stored fields with `declared`, and
lists the fields computed from them in `computed_fields`. A field that is computed from several results is declared in
the module that computes it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import MISSING, dataclass, field, fields
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import xarray


#: Names of the dimensions of a field, in the order of its axes.
Dimensions = tuple[str, ...]
STEP = ("step",)  # one value for each load step
CELL = ("step", "cell1", "cell2")  # cells of the surface
STATE = ("state",)  # contact states of the surface
CELL_STATE = (
    "state",
    "state_cell1",
    "state_cell2",
)  # cells of the surface in its contact states
ROW = ("step", "row")  # rows of pixels
PIXEL = ("step", "x1", "x2")  # pixels
BLOCK = ("step", "block1", "block2")  # blocks of pixels
FACE = ("face1", "face2")  # blocks of the surface, the same for all load steps
REALISATION = ("realisation", "step")  # realisations of a seal
PATCH = ("patch", "step")  # measured patches
PATCH_FACE = ("patch1", "patch2")  # blocks of one measured patch, the same for all load steps
PATCH_BLOCK = ("step", "patch1", "patch2")  # blocks of one measured patch
TILE = ("step", "part")  # tiles of a realisation
TILE_FORM = ("part",)  # tiles of a realisation, the same for all load steps
TILE_VECTOR = ("step", "part", "plane")  # vectors on the tiles of a realisation
CORNER = ("part", "corner", "plane")  # corners of the tiles of a realisation
LEAK_CLASS = ("leak_class", "step")  # leakage classes
ERROR_SOURCE = ("budget_part", "step")  # error sources

#: Replaces the characters of units that are not allowed in names of ASCII letters, digits and underscores.
_LETTERS = str.maketrans({"/": "_per_", "·": "_", "*": "_", " ": "_"}) | str.maketrans(
    "³²µ",
    "32u",
    "()^",  # the last characters are left out
)
#: Units of pictures and of files for ParaView, and the factors of the conversion, by SI unit.
READABLE = {
    "m": ("µm", 1e6),
    "Pa": ("MPa", 1e-6),
    "m^3": ("m³", 1.0),
    "m^2/s": ("m²/s", 1.0),
    "1": ("", 1.0),
}


@dataclass(frozen=True)
class Field:
    """Describe a field of the results.

    Parameters
    ----------
    name : str
        Name of the field in the dataset and in all files.
    unit : str
        SI unit, such as "m^2/s", or "1" for a number without a unit.
    long_name : str
        Short description of the field.
    dimensions : tuple of str
        Names of the dimensions, in the order of the axes.
    heading : str
        Heading of the column in printed tables, "" if no table contains the field. Only fields with one value per load
        step can be table columns and have a heading.
    """

    name: str
    unit: str
    long_name: str
    dimensions: Dimensions
    heading: str = ""

    @classmethod
    def from_variable(cls, variable: xarray.DataArray) -> Field:
        """Reconstruct the declaration of a field from the attributes of a dataset variable."""
        attrs = variable.attrs
        return cls(
            name=str(variable.name),
            unit=attrs["units"],
            long_name=attrs["long_name"],
            dimensions=tuple(map(str, variable.dims)),
            heading=str(attrs.get("heading", "")),
        )

    @property
    def attrs(self) -> dict[str, Any]:
        """Unit, description and heading of the field, as attributes of its variable in a dataset."""
        attributes = {"units": self.unit, "long_name": self.long_name}
        if self.heading:
            attributes["heading"] = self.heading
        return attributes

    @property
    def scale(self) -> float:
        """Factor from the SI unit to the unit used in pictures and ParaView files."""
        return READABLE.get(self.unit, ("", 1.0))[1]

    @property
    def array_name(self) -> str:
        """Name of the field in files for ParaView, which includes the unit in these files, such as "mean_gap_um"."""
        readable_unit, _ = READABLE.get(self.unit, (self.unit, 1.0))
        return with_unit(self.name, readable_unit)

    @property
    def column_name(self) -> str:
        """Name of the field in machine-readable tables, which includes the SI unit, such as "leakage_mean_m2_per_s"."""
        return with_unit(self.name, self.unit)


def with_unit(name: str, unit: str) -> str:
    """Append a unit to a name, in ASCII letters, digits and underscores.

    Examples
    --------
    >>> with_unit("gap", "µm"), with_unit("leakage", "mL/(m·min)")
    ('gap_um', 'leakage_mL_per_m_min')
    >>> with_unit("flux", "m^2/s"), with_unit("slope", "1")
    ('flux_m2_per_s', 'slope')
    """
    if unit in ("", "1"):
        return name
    return f"{name}_{unit.translate(_LETTERS)}"


def declared(
    name: str,
    unit: str,
    long_name: str,
    dimensions: Dimensions,
    *,
    heading: str = "",
    default: Any = MISSING,
    repr: bool = True,
) -> Any:
    """Declare an attribute of a dataclass that is a field of the results.

    The first five parameters are the attributes of `Field`; `default` and `repr` are passed to `dataclasses.field`.
    """
    declaration = Field(name, unit, long_name, dimensions, heading)
    metadata = {"field": declaration, "unit": unit, "long_name": long_name}
    return field(default=default, repr=repr, metadata=metadata)


def fields_of(result: Any) -> Iterator[tuple[Field, Any]]:
    """Yield the declared fields of a result with their values.

    Fields whose value is None are left out. The stored fields come first, then the computed fields.
    """
    stored = {f.name: f.metadata["field"] for f in fields(result) if "field" in f.metadata}
    computed = getattr(result, "computed_fields", {})
    for attribute, declaration in (stored | computed).items():
        values = getattr(result, attribute)
        if values is not None:
            yield declaration, values
