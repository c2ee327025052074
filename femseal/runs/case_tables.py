"""Tables of a case file except those of the faces and the load: solids, contact, flow, fluid, seal, windows, draws and
output.

Fluids and shapes of seals are not named here: whatever is registered in `fluids.FLUIDS` and `seal.layouts.LAYOUTS` has
a table, with a key for each of its parameters.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import BeforeValidator, Field, WithJsonSchema, model_validator
from pydantic_core import PydanticCustomError

from ..base.errors import InputError
from ..base.leak_units import LEAK_UNITS, LeakUnit, leak_unit
from ..flow import DISCRETISATIONS, SOLVERS
from ..flow.discretisation import check_discretisation
from ..fluids import FLUIDS, Fluid
from ..materials import Solid
from ..results.fields import LIMIT
from ..results.vtk import FORMATS
from ..seal.layouts import LAYOUTS, Layout
from ..studies import CONTACTS, DRAWS, FLOWS, PRESSURES
from .case_registry import table_of_any
from .case_values import Count, FileSize, Length, Modulus, Poisson, Pressure, Ratio, Table, one_of

Boundary = Literal["periodic", "mirror", "free"]


class SolidTable(Table):
    """A solid, see `materials.Solid`."""

    young: Modulus
    poisson: Poisson = 0.3
    yield_stress: Modulus | None = None
    hardness: Modulus | None = None

    @model_validator(mode="after")
    def _one_strength(self) -> SolidTable:
        if self.yield_stress is not None and self.hardness is not None:
            raise PydanticCustomError("strength", "yield_stress or hardness, not both")
        return self

    @property
    def solid(self) -> Solid:
        """The solid."""
        return Solid(**self.model_dump())


class ContactTable(Table):
    """How contact is solved."""

    boundary: tuple[Boundary, Boundary] = ("free", "periodic")
    rtol: Annotated[float, Field(gt=0, lt=0.1)] = 1e-5


class FlowTable(Table):
    """How flow is discretised and solved, in windows, in whole faces and over the seal."""

    solver: Annotated[str, *one_of(SOLVERS)] = "auto"
    discretisation: Annotated[str, *one_of(DISCRETISATIONS)] = "edge"

    @model_validator(mode="after")
    def _together(self) -> FlowTable:
        try:
            check_discretisation(self.discretisation, self.solver)
        except InputError as error:
            raise PydanticCustomError("flow", "flow.{fault}", {"fault": str(error)}) from None
        return self


class FluidTable(Table):
    """A fluid, with a key for each of its parameters, and its pressures at both ends."""

    if TYPE_CHECKING:
        kind: str
        inlet_pressure: float
        outlet_pressure: float

    @property
    def fluid(self) -> Fluid:
        """The fluid."""
        return FLUIDS[self.kind](**self.model_dump(exclude={"kind", "inlet_pressure", "outlet_pressure"}))


class SealTable(Table):
    """The shape of the seal, with a key for each of its parameters."""

    if TYPE_CHECKING:
        kind: str

    @property
    def layout(self) -> Layout:
        """The shape."""
        return LAYOUTS[self.kind](**self.model_dump(exclude={"kind"}))


def _pressures(fluid: Any) -> dict[str, Any]:
    return {"inlet_pressure": (Pressure, ...), "outlet_pressure": (Pressure, fluid.outlet_pressure)}


if TYPE_CHECKING:
    AnyFluid = FluidTable
    AnySeal = SealTable
else:
    AnyFluid = table_of_any(FLUIDS, FluidTable, _pressures)
    AnySeal = table_of_any(LAYOUTS, SealTable)


class CellsTable(Table):
    """Windows of the two-scale and stochastic methods: their number, or about their size; their contact and flow.

    flow, contact : see `studies.two_scale`.
    """

    count: tuple[Count, Count] | None = None
    size: Length | None = None
    flow: Annotated[str, *one_of(FLOWS)] | None = None
    contact: Annotated[str, *one_of(CONTACTS)] | None = None

    @model_validator(mode="after")
    def _one_of(self) -> CellsTable:
        if (self.count is None) == (self.size is None):
            raise PydanticCustomError("cells", "one of `count` and `size`")
        return self


class StochasticTable(Table):
    """How a seal is drawn, see `studies.Sampling`."""

    length: Length
    breadth: Length | None = None
    realisations: Annotated[int, Field(strict=True, ge=2)] = 50
    library_cells: Count = 128
    sampler: Annotated[str, *one_of(DRAWS)] | None = None
    pressure: Annotated[str, *one_of(PRESSURES)] = "place"
    library: Path | None = None
    width: Annotated[float, Field(gt=0)] | None = None
    bounds: bool = False
    quantiles: tuple[Ratio, Ratio] = (0.05, 0.95)

    @model_validator(mode="after")
    def _ordered(self) -> StochasticTable:
        if not self.quantiles[0] < self.quantiles[1]:
            raise PydanticCustomError("quantiles", "two rising `quantiles`")
        return self


#: What the schema says of units.
_UNITS_TOLD = f"a unit of leakage: {', '.join(LEAK_UNITS)}"


def _leak_unit_name(value: Any) -> str:
    try:
        return leak_unit(value).name
    except InputError as error:
        raise PydanticCustomError("name", "{allowed}", {"allowed": str(error).split("allowed is ")[-1]}) from None


class OutputTable(Table):
    """Optional contents of the results folder, see `report.write_folder`, and the unit in which leakage is told."""

    paraview: Annotated[str, *one_of(FORMATS)] = "vtu"
    fields_limit: FileSize = LIMIT
    leakage_unit: Annotated[
        str | None, BeforeValidator(_leak_unit_name), WithJsonSchema({"type": "string", "description": _UNITS_TOLD})
    ] = None

    @property
    def unit(self) -> LeakUnit | None:
        """The unit, or None for a readable one per length of seal."""
        return None if self.leakage_unit is None else LEAK_UNITS[self.leakage_unit]
