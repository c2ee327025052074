"""Shapes of seals that a case can choose: each lays tiles out over a seal of real size.

To add a shape, write a frozen dataclass with its `kind`, the parameters that a case gives (see `base.validate`) and
`lay_out`, and put it into `LAYOUTS`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import isfinite, pi
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal, Protocol

from ..base import InputError, Pair, shown, to_si, to_text, validate
from ..base.validate import check_parameters, described, parameter
from .lay import Lay, check_inlet, check_ring, check_size
from .pressure_map import Frame

if TYPE_CHECKING:
    from ..flow.spiral import Spiral
    from .mesh_seal import MeshSeal
    from .tiles import CellSize, SealTiles


#: Directions of the lay by name: those of the axes of the plane, and those as seen from the centre of the seal.
NAMES = ("x1", "x2", "radial", "circumferential")
_ALLOWED = (
    f"one of {', '.join(NAMES)}, {{angle = '30 deg'}} from x1 to x2, {{kind = 'spiral', lead = '60 um', starts = 1}}, "
    "or {field = 'file.vtu:name'}"
)
#: Smallest circumference of a seal [m].
_LEAST_TURN = 1e-6


def lay_of(given: Any, folder: Path = Path()) -> Lay:
    """The lay by its name, {"angle": radians or "30 deg"}, {"kind": "spiral", "lead": metres or "60 um", "starts": 1},
    {"field": "file.vtu:name"} in the folder, or a `Lay`.

    Raises InputError: anything else.
    """
    match given:
        case Lay():
            return given
        case str() if given in NAMES:
            return Lay(name=given)
        case {"angle": angle} if len(given) == 1:
            return Lay(angle=_si(angle, "rad", "lay.angle"))
        case {"kind": "spiral"} if {*given} <= {"kind", "lead", "starts", "circumference"}:
            around = given.get("circumference")
            turn = None if around is None else _length(around, "lay.circumference", _LEAST_TURN)
            starts = validate.count("lay.starts", given.get("starts", 1))
            lead = _length(given.get("lead"), "lay.lead")
            return Lay(name="spiral", lead=lead * starts, circumference=turn)
        case {"field": str(field)} if len(given) == 1:
            path, _, array = field.rpartition(":")
            if path and array:
                return Lay(file=folder / path, array=array)
    raise InputError("lay", shown(given), _ALLOWED)


def _si(given: Any, unit: str, name: str) -> float:
    """A value in SI from text with a unit, or from a finite number."""
    if isinstance(given, (int, float)) and not isinstance(given, bool) and isfinite(given):
        return float(given)
    return to_si(given, unit, name)


def _length(given: Any, name: str, least: float = 0.0) -> float:
    """A length from text with a unit, or from a number of metres; InputError where it is less than the least."""
    value = _si(given, "m", name)
    if value < least:
        raise InputError(name, shown(given), f"a length >= {to_text(least, 'm')}, such as '60 um'")
    return value


class Layout(Protocol):
    """Interface of the shapes of seals that studies take; as text, the name of the seal for people."""

    kind: ClassVar[str]
    #: Whether the sampling gives the length of the seal.
    has_length: ClassVar[bool]

    def lay_out(self, cell_size: CellSize) -> SealTiles:
        """Lay tiles out over the seal, each as large as a cell of the face.

        Raises InputError: a size that is not given, or given twice; cells broader than the seal.
        """
        ...

    def frame(self, size: Pair) -> Frame:
        """Coordinates of maps of the pressure on a seal of this shape, of sides, or breadth and length [m]."""
        ...


_INLET = "side of the ring, or boundaries of the mesh"


_LAY = (
    "direction of x2 of the face on the seal; tables {angle = '30 deg'}, "
    "{kind = 'spiral', lead = '60 um', starts = 1}, {field = 'file.vtu:name'}"
)


@dataclass(frozen=True)
class RectangularLayout:
    """A straight strip; it goes on periodically along x2.

    lay : of the face on the strip, see `Lay`; along x2, as on the face, unless given.
    """

    kind: ClassVar[str] = "rectangular"
    has_length: ClassVar[bool] = True
    lay: Any = described(_LAY, default="x2")

    def __post_init__(self) -> None:
        lay = lay_of(self.lay)
        if lay.name == "radial" or lay.file is not None:
            raise InputError("lay", f"'{lay}' on a strip", "x1, x2, a spiral or an angle")
        around = lay.name == "circumferential" or (lay.name == "spiral" and lay.lead == 0)
        object.__setattr__(self, "lay", Lay(name="x2") if around else lay)

    def lay_out(self, cell_size: CellSize) -> SealTiles:
        """Rows and columns of tiles."""
        from .tiles import laid_on_strip

        if cell_size.length is None:
            raise InputError("length", "none", "the length of a rectangular seal")
        return laid_on_strip(cell_size, self.lay)

    @property
    def spiral(self) -> Spiral | None:
        """How the grooves of the face wind, if they do; None for rings."""
        from ..flow.spiral import Spiral

        return Spiral(self.lay.lead, self.lay.circumference) if self.lay.name == "spiral" else None

    def frame(self, size: Pair) -> Frame:
        """x1 from the inlet, and x2."""
        return Frame.of_strip(size)

    def __str__(self) -> str:
        return "a strip" if self.lay.name == "x2" else f"a strip, lay {self.lay}"


@dataclass(frozen=True)
class AnnularLayout:
    """A ring, which leaks along the radius.

    inner_radius, outer_radius : [m]. inlet : at the "inner" or the "outer" one.
    lay : of the face on the ring, see `Lay`; "circumferential" unless given.
    """

    kind: ClassVar[str] = "annular"
    has_length: ClassVar[bool] = False
    inner_radius: float = parameter(
        "m", "a length > 0, such as '10 mm'", "of the ring", usual=(1e-5, 100.0)
    )
    outer_radius: float = parameter(
        "m", "a length > 0, such as '15 mm'", "of the ring", usual=(1e-5, 100.0)
    )
    inlet: Literal["inner", "outer"] = described(_INLET, default="inner")
    lay: Any = described(_LAY, default="circumferential")

    def __post_init__(self) -> None:
        check_parameters(self)
        lay = lay_of(self.lay)
        around = lay.name == "spiral" and not lay.lead
        object.__setattr__(self, "lay", Lay(name="circumferential") if around else lay)
        if self.lay.file is not None:
            raise InputError("lay", f"'{self.lay}' on a ring", "a field on a mesh only")
        check_ring(self.inner_radius, self.outer_radius, self.inlet)
        self.lay.check_lead(self.outer_radius - self.inner_radius)
        check_size("outer_radius", 2 * self.outer_radius)

    def lay_out(self, cell_size: CellSize) -> SealTiles:
        """Rows of tiles along the radius, columns along the angle."""
        _refuse_sizes(self.kind, cell_size)
        from .tiles import laid_on_ring

        return laid_on_ring(cell_size, self.lay, (self.inner_radius, self.outer_radius), self.inlet)

    @property
    def circumference(self) -> float:
        """At the middle of the ring [m]."""
        return pi * (self.inner_radius + self.outer_radius)

    @property
    def spiral(self) -> Spiral | None:
        """How the grooves of the face wind at the middle of the ring, if they do."""
        from ..flow.spiral import Spiral

        return Spiral(self.lay.lead, self.circumference) if self.lay.name == "spiral" else None

    def frame(self, size: Pair) -> Frame:
        """Radius and angle."""
        ends = self.inner_radius, self.outer_radius
        return Frame(ends=ends if self.inlet == "inner" else ends[::-1])

    def __str__(self) -> str:
        radii = " and ".join(to_text(r, "m") for r in (self.inner_radius, self.outer_radius))
        flow = "outwards" if self.inlet == "inner" else "inwards"
        return f"a ring between the radii {radii}, leaking {flow}, lay {self.lay}"


@dataclass(frozen=True)
class MeshLayout:
    """A seal of any plan shape, from a mesh file.

    path : the file, see `MeshSeal`. unit : of its lengths, such as "mm". inlet, outlet : names of boundaries, one or
    several each; all others are closed.
    lay : of the face on the seal, see `Lay`. centre : from which "radial", "circumferential" and the maps of the
    pressure are seen [m].
    length : by which leakage is divided [m]; that of the outlet unless given.
    """

    kind: ClassVar[str] = "mesh"
    has_length: ClassVar[bool] = False
    path: Path = described("file of the mesh, relative to the case", example="seal.msh")
    unit: str = described("of the lengths in the mesh", example="mm")
    inlet: str | tuple[str, ...] = described(_INLET, example="bore")
    outlet: str | tuple[str, ...] = described(
        "boundaries; all others are closed", example=["rim", "bolts"]
    )
    lay: Any = described(_LAY, default="circumferential")
    centre: tuple[float, float] = described(
        'of a lay `"circumferential"` or `"radial"`', example=["0 mm", "0 mm"], default=(0.0, 0.0)
    )
    length: float | None = described(
        "length that the leakage is divided by; of the outlet unless given",
        example="80 mm",
        default=None,
    )

    def __post_init__(self) -> None:
        to_si(f"1 {self.unit}", "m", "unit")
        if self.length is not None and not (isfinite(self.length) and self.length > 0):
            raise InputError("length", self.length, "a length > 0 [m]")
        object.__setattr__(self, "lay", lay_of(self.lay, Path(self.path).parent))
        if self.lay.name == "spiral":
            raise InputError("lay", f"'{self.lay}' on a mesh", "a spiral on a strip or a ring")
        check_inlet(self.inlet)
        for name in ("inlet", "outlet"):
            names = getattr(self, name)
            if not isinstance(names, str):
                object.__setattr__(self, name, tuple(names))

    def lay_out(self, cell_size: CellSize) -> SealTiles:
        """Each element is a tile, or shares one with its neighbours."""
        _refuse_sizes(self.kind, cell_size)
        from .tiles import laid_on_mesh

        return laid_on_mesh(cell_size, self.lay, self._seal, self.length, self.centre)

    @cached_property
    def _seal(self) -> MeshSeal:
        """The seal, which is read once; a run lays it out several times."""
        from .mesh_seal import MeshSeal

        return MeshSeal(self.path, self.inlet, self.outlet, self.unit)

    def frame(self, size: Pair) -> Frame:
        """Radius and angle around `centre`."""
        return Frame(centre=self.centre)

    def __str__(self) -> str:
        return f"the mesh {Path(self.path).name}, lay {self.lay}"


def _refuse_sizes(kind: str, cell_size: CellSize) -> None:
    for name, value in (("length", cell_size.length), ("breadth", cell_size.breadth)):
        if value is not None:
            expected = f"none with a seal of kind {kind}: it has its own"
            raise InputError(name, to_text(value, "m"), expected)


#: Shapes that a case can choose, by their kind.
LAYOUTS: dict[str, Any] = {
    layout.kind: layout for layout in (RectangularLayout, AnnularLayout, MeshLayout)
}
