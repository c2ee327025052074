"""Fields of results, each declared once: name, unit, meaning, where it lives, heading of its column.

A declaration labels the field everywhere: in the dataset and its netCDF file, in files for ParaView, in tables and
pictures. Results of studies declare the fields that they have by `declared`, and those that are computed from
them in `computed_fields`; fields of several results are declared where they are computed.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import MISSING, dataclass, field, fields
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import xarray


#: Where the values of a field live: their dimensions in order, and what they belong to.
Place = tuple[str, ...]
STEP = ("step",)  # load steps
PIECE = ("step", "piece1", "piece2")  # pieces of the face
STATE = ("state",)  # states of the face
PIECE_STATE = ("state", "state_piece1", "state_piece2")  # pieces of the face in its states
ROW = ("step", "row")  # rows of pixels of the face
PIXEL = ("step", "x1", "x2")  # pixels of the face
BLOCK = ("step", "block1", "block2")  # blocks of pixels
FACE = ("face1", "face2")  # blocks of the face, of no load step
REALISATION = ("realisation", "step")  # realisations of a seal
PLACE = ("place", "step")  # measured places of the face
PLACE_FACE = ("place1", "place2")  # blocks of one measured place, of no load step
PLACE_BLOCK = ("step", "place1", "place2")  # blocks of one measured place
PART = ("step", "part")  # parts of the drawn seal
PART_FORM = ("part",)  # parts of the drawn seal, of no load step
PART_VECTOR = ("step", "part", "plane")  # vectors of the parts of the drawn seal
CORNER = ("part", "corner", "plane")  # corners of the parts of the drawn seal
LEAK_CLASS = ("leak_class", "step")  # leakage classes
ERROR_SOURCE = ("budget_part", "step")  # sources of error

#: Signs of units in names of ASCII letters, digits and underscores.
_LETTERS = str.maketrans({"/": "_per_", "·": "_", "*": "_", " ": "_"}) | str.maketrans(
    "³²µ", "32u", "()^"
)
#: Unit in SI to the unit of pictures and of files for ParaView, and the number of these in one of SI.
READABLE = {
    "m": ("µm", 1e6),
    "Pa": ("MPa", 1e-6),
    "m^3": ("m³", 1.0),
    "m^2/s": ("m²/s", 1.0),
    "1": ("", 1.0),
}


@dataclass(frozen=True)
class Field:
    """A field of results.

    name : in the dataset and in all files. unit : in SI, such as "m^2/s"; "1" for a number. long_name : its meaning.
    place : where it lives. heading : of its column in tables for people, for a field over the load steps; "" for none.
    """

    name: str
    unit: str
    long_name: str
    place: Place
    heading: str = ""

    @classmethod
    def of(cls, variable: xarray.DataArray) -> Field:
        """The declaration of a variable of a dataset."""
        attrs, dims = variable.attrs, tuple(map(str, variable.dims))
        heading = str(attrs.get("heading", ""))
        return cls(str(variable.name), attrs["units"], attrs["long_name"], dims, heading)

    @property
    def attrs(self) -> dict[str, Any]:
        """Attributes of the variable in the dataset."""
        more = {"heading": self.heading} if self.heading else {}
        return {"units": self.unit, "long_name": self.long_name} | more

    @property
    def scale(self) -> float:
        """Factor from SI to the unit of pictures and of files for ParaView."""
        return READABLE.get(self.unit, ("", 1.0))[1]

    @property
    def array_name(self) -> str:
        """Name in files for ParaView, with that unit: "mean_gap_um"."""
        return with_unit(self.name, READABLE.get(self.unit, (self.unit, 1.0))[0])

    @property
    def column_name(self) -> str:
        """Name in tables for programs, with the unit in SI: "leakage_mean_m2_per_s"."""
        return with_unit(self.name, self.unit)


def with_unit(name: str, unit: str) -> str:
    """A name with a unit in ASCII letters, digits and underscores.

    >>> with_unit("gap", "µm"), with_unit("leakage", "mL/(m·min)"), with_unit("flux", "m^2/s"), with_unit("slope", "1")
    ('gap_um', 'leakage_mL_per_m_min', 'flux_m2_per_s', 'slope')
    """
    if unit in ("", "1"):
        return name
    return f"{name}_{unit.translate(_LETTERS)}"


def declared(
    name: str,
    unit: str,
    long_name: str,
    place: Place,
    *,
    heading: str = "",
    default: Any = MISSING,
    repr: bool = True,
) -> Any:
    """An attribute of a dataclass that is a `Field`, with what `dataclasses.field` takes."""
    made = Field(name, unit, long_name, place, heading)
    return field(
        default=default, repr=repr, metadata={"field": made, "unit": unit, "long_name": long_name}
    )


def fields_of(result: Any) -> Iterator[tuple[Field, Any]]:
    """Declared fields of a result with their values, without those that are None; computed ones come last."""
    stored = {f.name: f.metadata["field"] for f in fields(result) if "field" in f.metadata}
    for attribute, made in (stored | getattr(result, "computed_fields", {})).items():
        if (values := getattr(result, attribute)) is not None:
            yield made, values
