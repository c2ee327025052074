"""A case: the whole input of a run, as a TOML file whose quantities carry their units.

The file is checked as a whole before anything is computed; every fault is reported at once, with its key, what was
given and what is expected. `preparation.prepare` turns a case into the objects the studies take.
"""

from __future__ import annotations

from collections.abc import Iterator
from os.path import abspath, isfile
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from ..base import shortened, to_text
from ..base.leak_rates import check_classes
from ..contact import ContactLaw, softer_of
from ..flow.problem import SOLVERS
from ..fluids import leak_basis, potential_of
from ..materials import Solid, contact_modulus
from ..seal.layouts import Layout, MeshLayout, lay_of
from ..studies.choices import FLUID_EFFECTS
from .case_tables import AnyFluid, AnySeal, AnySeat, FluidTable, OutputTable, SolidTable
from .faces import Face, FileFace, SurfaceTable
from .faults import fault, faults_of, refusal
from .filling import filled, least_detrend
from .load import LoadTable
from .values import (
    Accuracy,
    Both,
    Count,
    Duration,
    FileSize,
    Length,
    Number,
    Ratio,
    Table,
    Usual,
    files_of,
    key,
)

Boundary = Literal["periodic", "mirror", "free"]
Method = Literal["deterministic", "two-scale", "blocks", "stochastic"]


class ContactTable(Table):
    """How contact is solved, and whether the fluid presses the faces apart, see `studies.Scene`."""

    boundary: Annotated[tuple[Boundary, Boundary], Both()] = key(
        "of the whole face along x1 and x2; one word: of both", ("free", "periodic")
    )
    rtol: float = key("complementarity residual", 1e-5, gt=0, lt=0.1)
    fluid_pressure: Literal[FLUID_EFFECTS] = key(  # type: ignore[valid-type]
        "it presses the faces apart, is trapped in closed pockets too, or is ignored",
        "acts",
        since="0.2",
    )


class FlowTable(Table):
    """How flow is solved, in pieces, in whole faces and over the seal."""

    solver: Literal[SOLVERS] = key(  # type: ignore[valid-type]
        "of the pressure in cells and over the seal", "auto"
    )


class CellsTable(Table):
    """Pieces of a measured place for all methods but the deterministic."""

    count: tuple[Count, Count] | None = key(
        "pieces along x1 and x2; unless given as drawn seals need, for two scales eight shortest "
        "waves a side, for blocks a quarter of a block, 256 points or less",
        None,
        example=[4, 8],
    )
    size: Annotated[Length, Usual(1e-7, 0.1, "m")] | None = key(
        "approximate side of a piece", None, example="60 um", instead="count"
    )

    @model_validator(mode="after")
    def _one_of(self) -> CellsTable:
        if self.count is not None and self.size is not None:
            raise refusal("one of `count` and `size`")
        return self


class StochasticTable(Table):
    """How a seal is drawn, see `studies.Sampling`."""

    length: Length | None = key(
        "of a strip, along x2; of the face unless given", None, start="10 mm"
    )
    breadth: Annotated[Length, Usual(1e-6, 1.0, "m")] | None = key(
        "of a strip, along x1; of the face unless given", None, example="2 mm"
    )
    realisations: Annotated[int, Field(strict=True, ge=2)] | None = key(
        "number of seals; as the band of error needs unless given", None, example=50
    )
    quantiles: tuple[Ratio, Ratio] = key("ends of the band between seals", (0.05, 0.95))

    @model_validator(mode="after")
    def _ordered(self) -> StochasticTable:
        if not self.quantiles[0] < self.quantiles[1]:
            raise refusal("two rising `quantiles`")
        return self


class Case(Table):
    """A validated case, all values in SI."""

    title: str = key("heading of the report", "", start="My seal", max_length=200)
    method: Method = key("how leakage is computed", "stochastic", start="stochastic")
    compare: tuple[Method, ...] = key("further methods to compare", (), example=["two-scale"])
    accuracy: Accuracy | None = key(
        "wanted relative error of the numbers; what the case leaves open is refined until then",
        None,
        example="10 %",
    )
    time_limit: Duration | None = key("of all attempts at that accuracy", None, example="1 h")
    seed: Number = key("of all draws, whatever the number of workers", 0, start=1)
    memory: FileSize | None = key(
        "limit above which a run is refused; the free memory unless given",
        None,
        example="16 GB",
        exclude=True,
    )
    face: tuple[Face, ...] = key(
        "the rough face; two, each under [[face]], are summed",
        needed="without a `path` or `patches`",
        min_length=1,
        max_length=2,
    )
    surface: SurfaceTable = key("repair of measured faces, and conditioning", SurfaceTable())
    material: SolidTable = key("the solid of the face")
    counter_material: SolidTable | None = key(
        "the solid of the counter-face; rigid and flat without this table", None
    )
    load: LoadTable = key(
        'nominal contact pressures; or forces on the seal, "10 kN", or on its length, "200 N/mm"'
    )
    contact: ContactTable = key("how the faces touch", ContactTable())
    flow: FlowTable = key("how the fluid flows", FlowTable())
    fluid: AnyFluid = key("the fluid and its pressures", needed="without a `name`")
    seal: AnySeal = key(
        "shape of the seal; a strip has its length in [stochastic]",
        {"kind": "rectangular"},
        validate_default=True,
    )
    seat: AnySeat = key(
        "form of the seat, added to the roughness",
        {"kind": "flat"},
        since="0.2",
        validate_default=True,
    )
    cells: CellsTable | None = key("pieces of the face, of several patches of each", None)
    stochastic: StochasticTable | None = key("seals that are drawn", None)
    output: OutputTable = key("what is written, and how", OutputTable())
    folder: Path = Field(default=Path(), exclude=True)
    named_warnings: tuple[str, ...] = Field(default=(), exclude=True)

    @model_validator(mode="before")
    @classmethod
    def _filled(cls, data: dict[str, Any]) -> dict[str, Any]:
        return filled(data)

    @model_validator(mode="after")
    def _complete(self) -> Case:
        """Raise a fault if keys of several tables do not go together, or a file does not exist."""
        output = self.output
        if self.accuracy is not None and not output.budget:
            expected = "true: attempts end by their error budget"
            raise fault("output.budget", "false with accuracy", expected)
        if self.time_limit is not None and self.accuracy is None:
            expected = "one with accuracy, whose attempts it ends"
            raise fault("time_limit", "a time without accuracy", expected)
        if self.load.unit == "Pa" and self.load.highest >= self.law.capacity:
            expected = f"pressures below the hardness, {to_text(self.law.capacity, 'Pa')}"
            raise fault("load", to_text(self.load.highest, "Pa"), expected)
        for name, fluid in (("fluid", self.fluid), ("output.test_fluid", output.test_fluid)):
            if fluid is not None:
                self._check_inlet(f"{name}.inlet_pressure", fluid.inlet_pressure, fluid)
                with faults_of(name):
                    potential_of(fluid.fluid, "inlet_pressure", fluid.inlet_pressure)
        self._check_output()
        if isinstance(first := self.face[0], FileFace) and first.placement:
            raise fault("face.0", ", ".join(sorted(first.placement)), "that in the second face")
        self._check_seal()
        self._check_seat()
        if self.load.map is not None:
            self._check_drawn_alone("load.map", "a map", "a face has one nominal pressure")
        if self.seal.form:
            self._check_drawn_alone("seal.form", "a form", "a face has the form that was measured")
            if self.load.map is not None:
                expected = "one of them: the form gives the pressure of the tiles"
                raise fault("load.map", "a map with seal.form", expected)
        for name, path in self.files():
            if not isfile(tried := self.folder / path):
                there = f"; none is at {shortened(abspath(tried))}"
                expected = f"a file that exists{there if tried.name.isprintable() else ''}"
                raise fault(name, f"'{shortened(path)}'", expected)
        return self

    @staticmethod
    def _check_inlet(key: str, pressure: float, fluid: FluidTable) -> None:
        """Raise a fault if the pressure at an inlet is not above that at the outlet."""
        if not pressure > fluid.outlet_pressure:
            expected = (
                f"a pressure above that of the outlet, {to_text(fluid.outlet_pressure, 'Pa')}"
            )
            raise fault(key, to_text(pressure, "Pa"), expected)

    def _check_output(self) -> None:
        """Raise a fault if the unit or a class of leakage does not go with the fluid that it is of."""
        output, tested = self.output, self.output.test_fluid or self.fluid
        basis, test = (
            leak_basis(table.fluid, 1.0, pressure_drop=tested.state.pressure_drop, **output.valve)
            for table in (self.fluid, tested)
        )
        unit = output.unit
        if unit is not None and (lack := basis.lacks(unit)) and test.lacks(unit):
            kind = "gas" if basis.is_gas else "liquid"
            raise fault("output.leakage_unit", f"{unit.name} for a {kind}", lack)
        with faults_of("output"):
            check_classes(output.classes, output.nominal_diameter, test)

    def _check_seal(self) -> None:
        """Raise a fault if the shape of the seal or its inlets do not go with the method, the lengths or the fluids."""
        layout, table = self.layout, self.stochastic
        if not layout.has_length and "stochastic" not in self.methods:
            given = f"{layout.kind} with the method {self.method}"
            raise fault("seal.kind", given, "it with stochastic, which draws its tiles")
        for name in ("length", "breadth") if table is not None and not layout.has_length else ():
            if (value := getattr(table, name)) is not None:
                expected = f"none with a seal of kind {layout.kind}: it has its own"
                raise fault(f"stochastic.{name}", to_text(value, "m"), expected)
        own = getattr(layout, "inlet_pressures", {})
        for name, pressure in own.items():
            self._check_inlet(f"seal.inlet.{name}", pressure, self.fluid)
        if own:
            self._check_drawn_alone("seal.inlet", "pressures", "a face has one inlet")
            if self.output.test_fluid is not None:
                given = "one with pressures of the inlets in seal.inlet"
                raise fault("output.test_fluid", given, "none with them")

    def _check_drawn_alone(self, key: str, given: str, why: str) -> None:
        """Raise a fault if what a key gives is not for drawn seals alone."""
        if others := self.methods - {"stochastic"}:
            given = f"{given} with the method {', '.join(sorted(others))}"
            raise fault(key, given, f"stochastic alone: {why}")

    def _check_seat(self) -> None:
        """Raise a fault if the form of the seat does not go with boundary, faces, seal or map."""
        kind, boundary = self.seat.kind, self.contact.boundary[0]
        if kind == "flat":
            return
        if boundary != "free":
            given = f"{boundary} along x1 with a {kind} seat"
            raise fault("contact.boundary", given, "free along x1")
        least = least_detrend(kind)
        order = 1 if self.surface.detrend is None else self.surface.detrend
        if any(isinstance(face, FileFace) for face in self.face) and order < least:
            given = f"{order} with a {kind} seat: the form would count twice"
            raise fault("surface.detrend", given, f"{least}: the form is that of [seat]")
        if self.load.map is not None:
            expected = "none: the form gives the pressure of the rows"
            raise fault("load.map", f"a map with a {kind} seat", expected)
        if self.layout.kind == MeshLayout.kind:
            raise fault("seal.kind", f"{self.layout.kind} with a {kind} seat", "a strip or a ring")

    def files(self) -> Iterator[tuple[str, Path]]:
        """Key and path, relative to the folder of the case, of every file that it names."""
        for face in (face for face in self.face if isinstance(face, FileFace)):
            name = "path" if face.patches is None else "patches"
            for table in face.each(self.folder):
                yield f"face.{name}", table.path or Path()
                yield from files_of(table.model_copy(update={"path": None}), "face")
        lay = lay_of(self.seal.lay).file
        yield from () if lay is None else [("seal.lay", lay)]
        for name in ("seal", "seat", "load"):
            yield from files_of(getattr(self, name), name)

    def __repr__(self) -> str:
        highest = to_text(self.load.highest, self.load.unit, 3)
        return f"<femseal.Case {self.title!r}: {', '.join(sorted(self.methods))}, loads up to {highest}>"

    __str__ = __repr__

    @property
    def layout(self) -> Layout:
        """The shape of the seal."""
        return self.seal.make(self.folder)

    @property
    def methods(self) -> set[str]:
        """The method and the methods to compare it with, as given."""
        return {self.method, *self.compare}

    @property
    def solids(self) -> tuple[Solid, Solid | None]:
        """The two bodies; None is rigid."""
        counter = self.counter_material
        return self.material.solid, None if counter is None else counter.solid

    @property
    def law(self) -> ContactLaw:
        """Contact law of the softer solid, at each depth where their curves cross; elastic where none yields."""
        return softer_of(
            self.material.law, None if self.counter_material is None else self.counter_material.law
        )

    @property
    def softer(self) -> str:
        """Key of the table of the softer solid, whose hardness decides."""
        tables = {"material": self.material, "counter_material": self.counter_material}
        laws = {
            name: table.law.mean_hardness for name, table in tables.items() if table is not None
        }
        return min(laws, key=lambda name: laws[name])

    @property
    def hardness_tolerance(self) -> float:
        """Relative error of the hardness of the softer solid, for the error budget."""
        return float(getattr(self, self.softer).hardness_tolerance)

    @property
    def modulus(self) -> float:
        """Contact modulus [Pa]."""
        return contact_modulus(*self.solids)

    def echo(self) -> dict[str, Any]:
        """The case in SI, as plain data."""
        return self.model_dump(mode="json", exclude_none=True)
