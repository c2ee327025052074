"""Define the tables of a case, which is the whole input of a run, and check that their values are consistent.

A case is read from a TOML file in which quantities have units. All keys are validated before anything is computed, and
all errors are reported together. Each error names the key, its value and the values that are expected.
`preparation.prepare` converts a case to the input of the studies.
"""

from __future__ import annotations

from collections.abc import Iterator
from os.path import abspath, isfile
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from ..base import InputError, shortened, to_text
from ..base.leak_classes import check_classes
from ..base.leak_rates import LeakBasis
from ..contact import Bodies, ContactLaw, checked_modulus, softer_of
from ..flow.problem import SOLVERS
from ..fluids import leak_basis, potential_of
from ..materials import Coated, Solid
from ..scene.choices import FLUID_EFFECTS
from ..seal.layouts import Layout, MeshLayout, parse_lay
from ..studies.study_list import (
    DEFAULT_STUDY,
    STUDY_NAMES,
    TWO_SCALE,
    names_with,
    studies_named,
)
from ..studies.study_type import Study
from .completed_tables import complete, least_detrend
from .faces import Face, FileFace, SurfaceTable
from .faults import errors_in_table, invalid_value
from .load import LoadTable
from .output_table import OutputTable
from .quantity_types import (
    Accuracy,
    Count,
    Duration,
    FileSize,
    Fraction,
    Length,
    Number,
    OneForBothAxes,
    UsualRange,
)
from .seal_tables import AnyFluid, AnySeal, AnySeat, FluidTable
from .solid_table import SolidTable
from .table_types import Table, files_in, key

Boundary = Literal["periodic", "mirror", "free"]
Method = Literal[STUDY_NAMES]  # type: ignore[valid-type]


class ContactTable(Table):
    """Settings of the contact solution, and whether the fluid pressure separates the faces, see `studies.Scene`."""

    boundary: Annotated[tuple[Boundary, Boundary], OneForBothAxes()] = key(
        "boundary conditions of the surface along x1 and x2; a single word applies to both",
        ("free", "periodic"),
    )
    rtol: float = key("residual at which the contact solver stops", 1e-5, gt=0, lt=0.1)
    fluid_pressure: Literal[FLUID_EFFECTS] = key(  # type: ignore[valid-type]
        "effect of the fluid pressure: it pushes the surfaces apart, or liquid is also "
        "trapped in closed pockets, or it is ignored",
        "acts",
        since="0.2",
    )


class FlowTable(Table):
    """How the flow is solved: in cells, in whole surfaces and over the seal."""

    solver: Literal[SOLVERS] = key(  # type: ignore[valid-type]
        "solver of the flow through cells and through the seal", "auto"
    )


class CellsTable(Table):
    """How a measured surface is cut into cells, for all methods except the deterministic one."""

    count: tuple[Count, Count] | None = key(
        "number of cells along x1 and x2; by default, femseal chooses it for stochastic seals; for "
        "two-scale studies, a cell is eight of the shortest waves long; for blocks, it is a quarter of "
        "a block with at most 256 points",
        None,
        example=[4, 8],
    )
    size: Annotated[Length, UsualRange(1e-7, 0.1, "m")] | None = key(
        "approximate side of a cell", None, example="60 um", instead="count"
    )

    @model_validator(mode="after")
    def _check_keys(self) -> CellsTable:
        """Raise an InputError if the table has both the number and the size of the cells."""
        if self.count is not None and self.size is not None:
            raise invalid_value("either `count` or `size`")
        return self


class StochasticTable(Table):
    """How random realisations of a seal are made, see `studies.Sampling`."""

    length: Length | None = key(
        "length of a strip along x2; by default, the length of the surface", None, start="10 mm"
    )
    breadth: Annotated[Length, UsualRange(1e-6, 1.0, "m")] | None = key(
        "breadth of a strip along x1; by default, the breadth of the surface", None, example="2 mm"
    )
    realisations: Annotated[int, Field(strict=True, ge=2)] | None = key(
        "number of realisations; by default as many as the 95 % interval needs", None, example=50
    )
    quantiles: tuple[Fraction, Fraction] = key(
        "lower and upper quantile of the realisations", (0.05, 0.95)
    )

    @model_validator(mode="after")
    def _check_quantiles(self) -> StochasticTable:
        """Raise an InputError unless the first quantile is below the second one."""
        lower, upper = self.quantiles
        if lower >= upper:
            raise invalid_value("two rising `quantiles`")
        return self


class Case(Table):
    """A case: the whole input of a run, with all values in SI."""

    title: str = key("heading of the report", "", start="My seal", max_length=200)
    method: Method = key(  # type: ignore[valid-type]
        "how the leakage is computed", DEFAULT_STUDY.name, start=DEFAULT_STUDY.name
    )
    compare: tuple[Method, ...] = key(  # type: ignore[valid-type]
        "further methods, for comparison", (), example=[TWO_SCALE.name]
    )
    accuracy: Accuracy | None = key(
        "relative numerical error that you want; settings that the case leaves open are "
        "refined until it is reached",
        None,
        example="10 %",
    )
    time_limit: Duration | None = key(
        "time after which no further attempt to reach the accuracy begins", None, example="1 h"
    )
    seed: Number = key(
        "seed of the random numbers; results do not depend on the number of workers", 0, start=1
    )
    memory: FileSize | None = key(
        "a run that needs more memory than this is rejected; by default, the free memory of "
        "the machine",
        None,
        example="16 GB",
        exclude=True,
    )
    face: tuple[Face, ...] = key(
        "the rough surface; two tables [[face]] describe two faces, whose heights are added",
        needed="without a `path` or `patches`",
        min_length=1,
        max_length=2,
    )
    surface: SurfaceTable = key("repair and conditioning of the surface", SurfaceTable())
    material: SolidTable = key("the solid with the rough surface")
    counter_material: SolidTable | None = key(
        "the solid of the counter-face, which is rigid without this table", None
    )
    load: LoadTable = key(
        'nominal contact pressures, or forces on the seal ("10 kN") or per length of seal ("200 N/mm")'
    )
    contact: ContactTable = key("how the contact is solved", ContactTable())
    flow: FlowTable = key("how the flow is solved", FlowTable())
    fluid: AnyFluid = key("the fluid and its pressures", needed="without a `name`")
    seal: AnySeal = key(
        "shape of the seal; the length of a strip is given in [stochastic]",
        {"kind": "rectangular"},
        validate_default=True,
    )
    seat: AnySeat = key(
        "form of the seat, which is added to the roughness",
        {"kind": "flat"},
        since="0.2",
        validate_default=True,
    )
    cells: CellsTable | None = key(
        "division of the surface, or of each measured patch, into cells", None
    )
    stochastic: StochasticTable | None = key("random realisations of the seal", None)
    output: OutputTable = key("what is written, and how", OutputTable())
    folder: Path = Field(default=Path(), exclude=True)
    named_warnings: tuple[str, ...] = Field(default=(), exclude=True)

    @model_validator(mode="before")
    @classmethod
    def _complete(cls, data: dict[str, Any]) -> dict[str, Any]:
        return complete(data)

    @model_validator(mode="after")
    def _check(self) -> Case:
        """Raise an InputError if keys of several tables contradict each other, or a file does not exist."""
        self._check_accuracy()
        self._check_loads()
        self._check_pressures("fluid", self.fluid)
        if self.output.test_fluid is not None:
            self._check_pressures("output.test_fluid", self.output.test_fluid)
        self._check_output()
        self._check_faces()
        self._check_seal()
        self._check_seat()
        self._check_map_and_form()
        self._check_files()
        return self

    def _check_accuracy(self) -> None:
        """Raise an InputError if `accuracy` is given without an error budget, or `time_limit` without `accuracy`."""
        if self.accuracy is not None and not self.output.budget:
            expected = "true, because the error budget says when the accuracy is reached"
            raise InputError("output.budget", "false with accuracy", expected)
        if self.time_limit is not None and self.accuracy is None:
            expected = "a time limit only with accuracy, whose attempts it limits"
            raise InputError("time_limit", "a time without accuracy", expected)

    def _check_loads(self) -> None:
        """Raise an InputError if the highest pressure of the load cycle is not below the hardness.

        Forces are checked later, because the area of the seal is needed to convert them to nominal pressures.
        """
        if self.load.unit == "Pa" and self.load.highest >= self.law.capacity:
            expected = f"pressures below the hardness, {to_text(self.law.capacity, 'Pa')}"
            raise InputError("load", to_text(self.load.highest, "Pa"), expected)

    def _check_pressures(self, table_key: str, table: FluidTable) -> None:
        """Raise an InputError if the inlet pressure of a fluid is not above the outlet pressure.

        An InputError is also raised if the inlet pressure is outside the range in which the properties of the fluid are
        defined.
        """
        if not table.inlet_pressure > table.outlet_pressure:
            outlet = to_text(table.outlet_pressure, "Pa")
            expected = f"a pressure above that of the outlet, {outlet}"
            given = to_text(table.inlet_pressure, "Pa")
            raise InputError(f"{table_key}.inlet_pressure", given, expected)
        with errors_in_table(table_key):
            potential_of(table.fluid, "inlet_pressure", table.inlet_pressure)

    def _check_output(self) -> None:
        """Raise an InputError if the leakage unit or a leakage class does not suit the fluid or the test fluid."""
        output = self.output
        tested_fluid = output.test_fluid or self.fluid
        pressure_drop = tested_fluid.state.pressure_drop

        def basis_of(table: FluidTable) -> LeakBasis:
            """Return the quantities with which the leakage of a fluid is converted between units."""
            return leak_basis(table.fluid, 1.0, pressure_drop=pressure_drop, **output.valve)

        service_basis = basis_of(self.fluid)
        test_basis = basis_of(tested_fluid)
        unit = output.unit
        if unit is not None and service_basis.lacks(unit) and test_basis.lacks(unit):
            kind = "gas" if service_basis.is_gas else "liquid"
            given = f"{unit.name} for a {kind}"
            raise InputError("output.leakage_unit", given, service_basis.lacks(unit))
        with errors_in_table("output"):
            check_classes(output.classes, output.nominal_diameter, test_basis)

    def _check_faces(self) -> None:
        """Raise an InputError if the first face has keys that position one face on the other, such as `shift`."""
        first = self.face[0]
        if isinstance(first, FileFace) and first.placement:
            given = ", ".join(sorted(first.placement))
            raise InputError(
                "face.0",
                given,
                "no such keys in the table of the first face, only in the table of the second face",
            )

    def _check_seal(self) -> None:
        """Raise an InputError if the method or a length in [stochastic] does not suit the shape of the seal."""
        layout = self.layout
        if layout.has_length:
            return
        if not self.solves_realisations:
            given = f"{layout.kind} with the method {self.method}"
            method = names_with("has_realisations")
            expected = f"the method {method}, which covers a seal of this shape with tiles"
            raise InputError("seal.kind", given, expected)
        for name in ("length", "breadth"):
            value = getattr(self.stochastic, name, None)
            if value is not None:
                expected = f"no {name}, because a seal of kind {layout.kind} has its own"
                raise InputError(f"stochastic.{name}", to_text(value, "m"), expected)

    def _check_seat(self) -> None:
        """Raise an InputError if the seat is not flat, but another table of the case requires a flat seat.

        With a seat that is not flat, the contact must have a free boundary along x1, and the form must be removed from
        a measured face. The seal must be a strip or a ring, and a pressure map is not allowed.
        """
        kind = self.seat.kind
        boundary = self.contact.boundary[0]  # along x1
        if kind == "flat":
            return
        if boundary != "free":
            given = f"{boundary} along x1 with a {kind} seat"
            raise InputError("contact.boundary", given, "free along x1")
        least_order = least_detrend(kind)
        order = 1 if self.surface.detrend is None else self.surface.detrend
        is_measured = any(isinstance(face, FileFace) for face in self.face)
        if is_measured and order < least_order:
            given = f"{order} with a {kind} seat, so that its form would count twice"
            expected = f"{least_order}, because [seat] gives the form"
            raise InputError("surface.detrend", given, expected)
        if self.load.map is not None:
            expected = "no map, because the form of the seat determines the pressure"
            raise InputError("load.map", f"a map with a {kind} seat", expected)
        if self.layout.kind == MeshLayout.kind:
            given = f"{self.layout.kind} with a {kind} seat"
            raise InputError("seal.kind", given, "a strip or a ring")

    def _check_map_and_form(self) -> None:
        """Raise an InputError if a method of the case cannot use the pressure map or the form deviation of the seal.

        An InputError is also raised if the case has both a pressure map and a form deviation of the seal.
        """
        if self.load.map is not None:
            reason = "the other methods have one nominal pressure"
            self._check_only_realisations("load.map", "a map", reason)
        if self.seal.form:
            reason = "the other methods have the measured form of the surface"
            self._check_only_realisations("seal.form", "a form", reason)
            if self.load.map is not None:
                expected = "a map or a form, because the form determines the pressure as well"
                raise InputError("load.map", "a map with seal.form", expected)

    def _check_only_realisations(self, name: str, given: str, reason: str) -> None:
        """Raise an InputError if a key that only a method with realisations can use is combined with other methods.

        Parameters
        ----------
        name : name of the key.
        given : short description of the value of the key, for the error message.
        reason : reason why the other methods cannot use the key, for the error message.
        """
        others = [study.name for study in self.studies if not study.has_realisations]
        if others:
            given = f"{given} with the method {', '.join(sorted(others))}"
            method = names_with("has_realisations")
            raise InputError(name, given, f"{method} alone, because {reason}")

    def _check_files(self) -> None:
        """Raise an InputError if a file that the case names does not exist."""
        for name, path in self.files():
            full_path = self.folder / path
            if isfile(full_path):
                continue
            expected = "a file that exists"
            if full_path.name.isprintable():
                expected += f"; none is at {shortened(abspath(full_path))}"
            raise InputError(name, f"'{shortened(path)}'", expected)

    def files(self) -> Iterator[tuple[str, Path]]:
        """Yield the key and the path of each file in the case; paths are relative to the folder of the case."""
        for face in self.face:
            if not isinstance(face, FileFace):
                continue
            name = "path" if face.patches is None else "patches"
            for table in face.maps(self.folder):
                yield f"face.{name}", table.path or Path()
                other_files = table.model_copy(update={"path": None})
                yield from files_in(other_files, "face")
        lay_file = parse_lay(self.seal.lay).file
        if lay_file is not None:
            yield "seal.lay", lay_file
        yield from files_in(self.seal, "seal")
        yield from files_in(self.seat, "seat")
        yield from files_in(self.load, "load")

    def __repr__(self) -> str:
        methods = ", ".join(sorted(self.methods))
        highest = to_text(self.load.highest, self.load.unit, 3)
        return f"<femseal.Case {self.title!r}: {methods}, loads up to {highest}>"

    __str__ = __repr__

    @property
    def layout(self) -> Layout:
        """Shape of the seal, and how tiles are placed on it."""
        return self.seal.make(self.folder)

    @property
    def methods(self) -> set[str]:
        """All methods of the run, from the keys `method` and `compare`."""
        return {self.method, *self.compare}

    @property
    def studies(self) -> list[Study]:
        """Studies of all methods, in the order in which they are solved."""
        return studies_named(self.methods)

    @property
    def solves_realisations(self) -> bool:
        """Whether a method solves realisations of a whole seal, and not only the surface."""
        return any(study.has_realisations for study in self.studies)

    @property
    def solids(self) -> tuple[Solid, Solid | None]:
        """Solid of the face and solid of the counter-face, without coatings; None for a rigid counter-face."""
        counter = self.counter_material
        return self.material.solid, None if counter is None else counter.solid

    @property
    def bodies(self) -> tuple[Solid | Coated, Solid | Coated | None]:
        """Body of the face and body of the counter-face, with their coatings; None for a rigid counter-face."""
        counter = self.counter_material
        return self.material.body, None if counter is None else counter.body

    @property
    def law(self) -> ContactLaw:
        """Contact law of the softer solid. If neither solid yields, the law is elastic.

        If the hardness curves of the two solids cross, the contact law uses the lower hardness at each depth.
        """
        counter = self.counter_material
        return softer_of(self.material.law, None if counter is None else counter.law)

    @property
    def body_yield_stress(self) -> float:
        """Yield stress [Pa] of the weaker solid below its surface, inf if no solid yields; see `SolidTable`."""
        solids = (self.material, self.counter_material)
        return min(solid.body_yield_stress for solid in solids if solid is not None)

    @property
    def softer(self) -> str:
        """Key of the table of the softer solid, "material" or "counter_material"."""
        counter = self.counter_material
        if counter is None or self.material.law.mean_hardness <= counter.law.mean_hardness:
            return "material"
        return "counter_material"

    @property
    def hardness_tolerance(self) -> float:
        """Relative error of the hardness of the softer solid, for the error budget."""
        return float(getattr(self, self.softer).hardness_tolerance)

    @property
    def hardness_over_yield(self) -> float:
        """Ratio of hardness to yield stress of the softer solid."""
        return float(getattr(self, self.softer).hardness_over_yield)

    @property
    def modulus(self) -> float | Bodies:
        """Contact modulus [Pa], or the pair of bodies if one of them is coated."""
        return checked_modulus(self.bodies)

    def echo(self) -> dict[str, Any]:
        """Return the case as plain data, with values in SI units."""
        return self.model_dump(mode="json", exclude_none=True)
