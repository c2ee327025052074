"""Define the shapes of seals that a case can choose: strips, rings and meshes, which are covered with tiles.

To add a shape, write a frozen dataclass with the properties and methods of the protocol `Layout`. The fields of the
dataclass are the parameters of the shape in a case (see `base.validate`). Then add the dataclass to `LAYOUTS`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal, Protocol

from ..base import InputError, Pair, shown, to_si, to_text, validate
from ..base.validate import check_parameters, described, parameter
from .frame import Frame
from .input_checks import check_inlet, check_size
from .lay import Lay
from .ring import Ring

if TYPE_CHECKING:
    from ..flow.spiral import Spiral
    from .mesh_seal import MeshSeal
    from .tiles import CellSize, SealTiles


#: Named directions of the lay: two along the axes of the plane, and two relative to the centre of the seal.
LAY_NAMES = ("x1", "x2", "radial", "circumferential")
_ALLOWED = (
    f"one of {', '.join(LAY_NAMES)}, {{angle = '30 deg'}} from x1 to x2, "
    "{kind = 'spiral', lead = '60 um', starts = 1}, or {field = 'file.vtu:name'}"
)
#: Smallest circumference of a seal [m].
_SMALLEST_CIRCUMFERENCE = 1e-6


def parse_lay(given: Any, folder: Path = Path()) -> Lay:
    """Convert the value of the key `lay` in a case to a `Lay`.

    Parameters
    ----------
    given : str, dict or Lay
        A name such as "radial", or one of the tables {"angle": "30 deg"}, {"kind": "spiral", "lead": "60 um", "starts":
        1} and {"field": "file.vtu:name"}. The angle can also be given as a number [rad], and the lead as a number [m].
        A `Lay` is returned unchanged.
    folder : Path
        Folder to which the path of a file with a vector field is relative.

    Raises
    ------
    InputError
        `given` is not a name, a table or a `Lay` as described above.
    """
    match given:
        case Lay():
            return given
        case str() if given in LAY_NAMES:
            return Lay(name=given)
        case {"angle": angle} if len(given) == 1:
            return Lay(angle=_to_si_value(angle, "rad", "lay.angle"))
        case {"kind": "spiral"} if {*given} <= {"kind", "lead", "starts", "circumference"}:
            circumference = given.get("circumference")
            if circumference is not None:
                name = "lay.circumference"
                circumference = _to_length(circumference, name, _SMALLEST_CIRCUMFERENCE)
            starts = validate.count("lay.starts", given.get("starts", 1))
            # a case gives the distance between neighbouring grooves; in one turn, a groove advances by this distance
            # times the number of starts
            groove_distance = _to_length(given.get("lead"), "lay.lead")
            lead = groove_distance * starts
            return Lay(name="spiral", lead=lead, circumference=circumference)
        case {"field": str(field)} if len(given) == 1:
            path, _, array = field.rpartition(":")
            if path and array:
                return Lay(file=folder / path, array=array)
    raise InputError("lay", shown(given), _ALLOWED)


def _to_si_value(given: Any, unit: str, name: str) -> float:
    """Convert a text with a unit to a value in SI units. A finite number is regarded as a value in SI units.

    unit : SI unit, such as "m".
    name : name of the key, for messages.
    """
    if isinstance(given, (int, float)) and not isinstance(given, bool):
        return validate.number(name, given, unit=unit, above=-inf)
    return to_si(given, unit, name)


def _to_length(given: Any, name: str, smallest: float = 0.0) -> float:
    """Convert a text with a unit, or a number, to a length [m]; raise InputError for a length below `smallest`."""
    value = _to_si_value(given, "m", name)
    if value < smallest:
        expected = f"a length >= {to_text(smallest, 'm')}, such as '60 um'"
        raise InputError(name, shown(given), expected)
    return value


class Layout(Protocol):
    """Define the properties and methods that a shape of seals needs. `str(shape)` describes the seal to the user."""

    kind: ClassVar[str]
    #: True if the length of the seal is a parameter of `Sampling`, False if the shape determines the length.
    has_length: ClassVar[bool]

    def lay_out(self, cell_size: CellSize) -> SealTiles:
        """Cover the seal with tiles that are as large as a cell of the surface.

        Raises
        ------
        InputError
            The length of the seal is missing; a length or width is given although the shape determines the size; or the
            cells are wider than the seal.
        """
        ...

    def frame(self, size: Pair) -> Frame:
        """Return the coordinates for pressure maps on a seal of the given size (width, length) [m]."""
        ...


#: Explanations of the keys `inlet` and `lay` of a case.
_INLET = "inlet: a side of the ring, or boundaries of the mesh"
_LAY = (
    "direction that the axis x2 of the surface has on the seal: a word, or a table such as {angle = '30 deg'}, "
    "{kind = 'spiral', lead = '60 um', starts = 1}, {field = 'file.vtu:name'}"
)


@dataclass(frozen=True)
class RectangularLayout:
    """Describe a straight strip that is periodic along x2.

    Parameters
    ----------
    lay : Lay, or any value that `parse_lay` accepts
        Direction of the lay on the strip, by default along x2, as on the measured surface.
    """

    kind: ClassVar[str] = "rectangular"
    has_length: ClassVar[bool] = True
    lay: Any = described(_LAY, default="x2")

    def __post_init__(self) -> None:
        lay = parse_lay(self.lay)
        if lay.name == "radial" or lay.file is not None:
            raise InputError("lay", f"'{lay}' on a strip", "x1, x2, a spiral or an angle")
        # x2 is the circumferential direction of a strip; the grooves of a spiral with the lead 0 run along x2 as well
        if lay.name == "circumferential" or (lay.name == "spiral" and lay.lead == 0):
            lay = Lay(name="x2")
        object.__setattr__(self, "lay", lay)

    def lay_out(self, cell_size: CellSize) -> SealTiles:
        """Cover the strip with rows and columns of tiles."""
        from .covering import cover_strip

        if cell_size.length is None:
            raise InputError("length", "none", "the length of a rectangular seal")
        return cover_strip(cell_size, self.lay)

    @property
    def spiral(self) -> Spiral | None:
        """Lead and circumference of the spiral grooves; None if the grooves are not a spiral."""
        from ..flow.spiral import Spiral

        return Spiral(self.lay.lead, self.lay.circumference) if self.lay.name == "spiral" else None

    def frame(self, size: Pair) -> Frame:
        """Return the coordinates of the strip: x1 is the distance from the inlet, and x2 runs along the seal."""
        return Frame.for_strip(size)

    def __str__(self) -> str:
        return "a strip" if self.lay.name == "x2" else f"a strip, lay {self.lay}"


@dataclass(frozen=True)
class AnnularLayout:
    """Describe a ring-shaped seal with radial leakage.

    Parameters
    ----------
    inner_radius, outer_radius : float
        Radii of the ring [m].
    inlet : "inner" or "outer"
        Radius at which the fluid enters.
    lay : Lay, or any value that `parse_lay` accepts
        Direction of the lay on the ring, by default circumferential.
    """

    kind: ClassVar[str] = "annular"
    has_length: ClassVar[bool] = False
    inner_radius: float = parameter(
        "m", "a length > 0", "10 mm", "inner radius of the ring", usual=(1e-5, 100.0)
    )
    outer_radius: float = parameter(
        "m", "a length > 0", "15 mm", "outer radius of the ring", usual=(1e-5, 100.0)
    )
    inlet: Literal["inner", "outer"] = described(_INLET, default="inner")
    lay: Any = described(_LAY, default="circumferential")

    def __post_init__(self) -> None:
        check_parameters(self)
        lay = parse_lay(self.lay)
        if lay.name == "spiral" and lay.lead == 0:
            lay = Lay(name="circumferential")
        object.__setattr__(self, "lay", lay)
        if self.lay.file is not None:
            raise InputError("lay", f"'{self.lay}' on a ring", "a field on a mesh only")
        self.lay.check_lead(self.ring.breadth)
        check_size("outer_radius", 2 * self.outer_radius)

    def lay_out(self, cell_size: CellSize) -> SealTiles:
        """Cover the ring with rows of tiles, which run around the ring. The first row of tiles is at the inlet."""
        _refuse_sizes(self.kind, cell_size)
        from .covering import cover_ring

        return cover_ring(cell_size, self.lay, self.ring)

    @property
    def ring(self) -> Ring:
        """Geometry of the ring; an InputError is raised if the radii or the inlet are invalid."""
        return Ring(self.inner_radius, self.outer_radius, self.inlet)

    @property
    def circumference(self) -> float:
        """Mean circumference of the ring [m]."""
        return self.ring.circumference

    @property
    def spiral(self) -> Spiral | None:
        """Lead and mean circumference of the spiral grooves; None if the grooves are not a spiral."""
        from ..flow.spiral import Spiral

        return Spiral(self.lay.lead, self.circumference) if self.lay.name == "spiral" else None

    def frame(self, size: Pair) -> Frame:
        """Return polar coordinates around the centre of the ring."""
        return Frame(ends=self.ring.ends)

    def __str__(self) -> str:
        radii = " and ".join(to_text(r, "m") for r in (self.inner_radius, self.outer_radius))
        flow = "outwards" if self.inlet == "inner" else "inwards"
        return f"a ring between the radii {radii}, leaking {flow}, lay {self.lay}"


@dataclass(frozen=True)
class MeshLayout:
    """Describe a seal of any plan shape that is given by a mesh file.

    Parameters
    ----------
    path : Path
        Mesh file, see `MeshSeal`.
    unit : str
        Unit of the coordinates in the file, such as "mm".
    inlet, outlet : str or tuple of str
        Names of the boundaries that form the inlet and the outlet. All other boundaries are closed.
    lay : Lay, or any value that `parse_lay` accepts
        Direction of the lay on the seal, by default circumferential.
    centre : tuple of two float
        Centre of a radial or circumferential lay, and of pressure maps in polar coordinates [m].
    length : float or None
        Length by which the leakage is divided [m], by default the length of the outlet.
    """

    kind: ClassVar[str] = "mesh"
    has_length: ClassVar[bool] = False
    path: Path = described("mesh file, relative to the case", example="seal.msh")
    unit: str = described("unit of the lengths in the mesh", example="mm")
    inlet: str | tuple[str, ...] = described(_INLET, example="bore")
    outlet: str | tuple[str, ...] = described(
        "boundaries that form the outlet; all boundaries other than inlet and outlet are closed",
        example=["rim", "bolts"],
    )
    lay: Any = described(_LAY, default="circumferential")
    centre: tuple[float, float] = described(
        'centre of a lay that is `"circumferential"` or `"radial"`',
        example=["0 mm", "0 mm"],
        default=(0.0, 0.0),
    )
    length: float | None = described(
        "length of the seal, by which the leakage is divided; by default the length of the outlet",
        example="80 mm",
        default=None,
    )

    def __post_init__(self) -> None:
        to_si(f"1 {self.unit}", "m", "unit")
        if self.length is not None:
            validate.number("length", self.length, unit="m")
        object.__setattr__(self, "lay", parse_lay(self.lay, Path(self.path).parent))
        if self.lay.name == "spiral":
            raise InputError("lay", f"'{self.lay}' on a mesh", "a spiral on a strip or a ring")
        check_inlet(self.inlet)
        for name in ("inlet", "outlet"):
            names = getattr(self, name)
            if not isinstance(names, str):
                object.__setattr__(self, name, tuple(names))

    def lay_out(self, cell_size: CellSize) -> SealTiles:
        """Make each element of the mesh a tile. Neighbouring elements that are smaller than a cell share a tile."""
        _refuse_sizes(self.kind, cell_size)
        from .covering import cover_mesh

        return cover_mesh(cell_size, self.lay, self._seal, self.length, self.centre)

    @cached_property
    def _seal(self) -> MeshSeal:
        """The seal in the mesh file, which is read at the first access and then kept in memory."""
        from .mesh_seal import MeshSeal

        return MeshSeal(self.path, self.inlet, self.outlet, self.unit)

    def frame(self, size: Pair) -> Frame:
        """Return polar coordinates around `centre`."""
        return Frame(centre=self.centre)

    def __str__(self) -> str:
        return f"the mesh {Path(self.path).name}, lay {self.lay}"


def _refuse_sizes(kind: str, cell_size: CellSize) -> None:
    """Raise InputError if a length or width is given for a seal whose shape determines the size."""
    for name, value in (("length", cell_size.length), ("breadth", cell_size.breadth)):
        if value is not None:
            expected = f"none with a seal of kind {kind}, whose shape determines the size"
            raise InputError(name, to_text(value, "m"), expected)


#: Shapes that a case can choose, by their kind.
LAYOUTS: dict[str, Any] = {
    layout.kind: layout for layout in (RectangularLayout, AnnularLayout, MeshLayout)
}
