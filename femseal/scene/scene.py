"""The input of all studies: a rough face under load, and the fluid that it seals."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from functools import partial
from operator import attrgetter
from typing import Any, Self

import numpy as np

from ..base import Array, Floats, InputError, Mapper, to_text
from ..contact import (
    STATE_FIELDS,
    Contact,
    ContactLaw,
    HalfSpace,
    LoadState,
    contact_at_loads,
    contact_law,
    load_states,
    solve_contact,
)
from ..face.cell_flow import FlowSettings
from ..flow import critical_constriction
from ..flow.law import FlowLaw, law_of
from ..flow.pressure_drop import PressureDrop, pressure_between
from ..fluids import Fluid, Liquid, capillary_entry_pressure, potential_of
from ..loads import LoadProgramme
from ..seal import Leakage, seal_leakage
from ..seal.layouts import Layout, RectangularLayout
from ..seal.shapes import Seal
from ..topography import Patches, Topography
from .choices import FLUID_EFFECTS, NOMINALS
from .fluid_coupling import LEAST_FRACTION, FluidPressure, contact_of_patches


@dataclass(frozen=True)
class Scene:
    """A rough surface under load, and the fluid that it seals.

    Parameters
    ----------
    surface : heights of the combined surfaces; high points touch first. A list of maps is `topography.Patches`, several
        measured patches of the surface: each is in contact by itself, and the fluid flows through all of them.
    modulus : contact modulus E* [Pa].
    hardness : H [Pa] of perfect plasticity, inf for an elastic surface; or a contact law, such as `LinearHardening`.
    fluid : the fluid that leaks.
    inlet_pressure, outlet_pressure : of the fluid at both ends of x1 [Pa]; the highest inlet pressure where the layout
        gives each inlet its own.
    boundary : contact boundary of the whole surface along x1 and x2, see `HalfSpace`.
    loading, unload_from, unloading : nominal pressures [Pa], see `LoadProgramme.of`.
    rtol : residual of each contact, see `contact.solve_contact`.
    layout : shape of stochastic seals, see `seal.layouts`; the surface itself is a strip.
    solver : of all flow, in cells and over the seal; see `flow.cell_permeability`.
    fluid_pressure : "acts": the fluid pressure acts on the surfaces, see `scene.fluid_coupling`; "trapped": besides,
        liquid in closed pockets keeps its volume, see `scene.trapped_liquid`; "ignored": the surfaces are in contact as
        without a fluid.
    nominal : what carries the nominal pressures where the fluid pressure acts: "total", contact and fluid together; or
        "contact", the contact alone.
    surroundings : pressure around the seal [Pa]; unless given, 1 atm for a gas and 0 for a liquid.

    Examples
    --------
    >>> import femseal as fs
    >>> face = fs.self_affine((32, 64), (32e-6, 64e-6), hurst=0.8, rms_slope=0.2, roll_off=20e-6, rng=1)
    >>> scene = fs.Scene(face, 115e9, 3e9, fs.Liquid(1e-3), 1e6, 0.0, loading=(5e7, 2e8))
    >>> [step.name for step in scene.steps]
    ['loading 50 MPa', 'loading 200 MPa']
    """

    surface: Topography | Patches
    modulus: float
    hardness: float | Array | ContactLaw
    fluid: Fluid
    inlet_pressure: float
    outlet_pressure: float
    loading: tuple[float, ...]
    unload_from: tuple[float, ...] = ()
    unloading: tuple[float, ...] = ()
    boundary: tuple[str, str] = ("free", "periodic")
    rtol: float = 1e-5
    layout: Layout = field(default_factory=RectangularLayout)
    solver: str = "auto"
    fluid_pressure: str = "acts"
    nominal: str = "total"
    surroundings: float | None = None

    def __post_init__(self) -> None:
        """Check that parts of the scene go together, see the class."""
        if not isinstance(self.surface, Topography | Patches):
            object.__setattr__(self, "surface", Patches(self.surface))
        for name, choices in (("fluid_pressure", FLUID_EFFECTS), ("nominal", NOMINALS)):
            if getattr(self, name) not in choices:
                raise InputError(name, getattr(self, name), f"one of {', '.join(choices)}")
        for name in ("inlet_pressure", "outlet_pressure"):
            potential_of(self.fluid, name, getattr(self, name))
        flow = self.flow  # raises if the solver is unknown
        most = max(self.inlet_pressure, self.outlet_pressure)
        hardness = float(np.min(self.law.yield_pressure()))
        if self.acting_fluid is not None and most >= hardness:
            expected = f"less than the hardness, {to_text(hardness, 'Pa')}"
            raise InputError("inlet_pressure", to_text(most, "Pa"), expected)
        if undefined := int(np.isnan(self.surface.heights).sum()):
            given = f"{undefined} of {self.surface.heights.size} points undefined"
            expected = (
                "a surface without undefined points: fill them first, see Topography.fill_undefined"
            )
            raise InputError("surface", given, expected)
        several = isinstance(self.surface, Patches)
        if self.traps_liquid and (
            several or flow.spiral or not hasattr(self.fluid, "bulk_modulus")
        ):
            given = "'trapped' with a gas, several patches or a spiral"
            expected = (
                "'acts' there: only a liquid can be trapped, in a single patch without a spiral lay"
            )
            raise InputError("fluid_pressure", given, expected)
        if isinstance(self.surface, Patches):
            self.surface.check_waves()

    @property
    def law(self) -> ContactLaw:
        """Contact law: the pressure that the points of the surface can carry."""
        return contact_law(self.hardness)

    @property
    def steps(self) -> LoadProgramme:
        """Load programme."""
        return LoadProgramme.of(self.loading, self.unload_from, self.unloading)

    @property
    def half_space(self) -> HalfSpace:
        """Elastic body of the whole surface."""
        return HalfSpace(self.surface.shape, self.surface.spacing, self.modulus, self.boundary)

    @property
    def is_dry(self) -> bool:
        """Whether the surfaces are in contact as without a fluid."""
        return self.fluid_pressure == "ignored"

    @property
    def traps_liquid(self) -> bool:
        """Whether liquid in closed pockets keeps its volume."""
        return self.fluid_pressure == "trapped"

    def dry(self, **changes: Any) -> Self:
        """Return the scene without the effect of the fluid on the contact, and with other changes."""
        return replace(self, fluid_pressure="ignored", **changes)

    @property
    def acting_fluid(self) -> FluidPressure | None:
        """Fluid whose pressure acts on the surfaces; None where it does not, or not enough to change the leakage."""
        # the viscosity of a liquid does not change how its pressure falls: contacts are those of all viscosities
        own = self.fluid
        if isinstance(own, Liquid) and own.pressure_viscosity == 0:
            own = Liquid(1.0, bulk_modulus=own.bulk_modulus)
        fluid = FluidPressure(
            own,
            self.inlet_pressure,
            self.outlet_pressure,
            self.nominal,
            self.flow,
            self.surroundings,
            self.traps_liquid,
        )
        acts = not self.is_dry and abs(fluid.carried) > LEAST_FRACTION * min(self.steps.pressures)
        return fluid if acts or self.traps_liquid else None

    @property
    def fluid_effect(self) -> str:
        """What the fluid pressure does to the contact, as text."""
        if self.is_dry:
            return "its pressure on the surfaces is ignored"
        if (fluid := self.acting_fluid) is None:
            return "it carries less than 0.01 % of every load: that changes leakage by less than 0.5 %, and is left out"
        carried = to_text(abs(fluid.carried), "Pa", 3)
        if fluid.carried < 0:
            return f"it pulls the surfaces together with a mean pressure of {carried}"
        given = "with the contact" if self.nominal == "total" else "besides the contact's"
        least = min((p for p in self.steps.pressures if p > 0), default=np.inf)
        most = f", up to {fluid.carried / least:.2g} of the load"
        stays = "; liquid in closed pockets keeps its volume" if fluid.trapped else ""
        return f"it pushes the surfaces apart, and carries about {carried} {given}{most}{stays}"

    @property
    def separated_steps(self) -> tuple[tuple[int, str], ...]:
        """Numbers of the steps at which the fluid between separated surfaces carries the whole load, and what it means.

        Cells at tabulated pressures are open there. The contact of a whole surface may hold the fluid back, see
        `scene.fluid_coupling`.
        """
        if (fluid := self.acting_fluid) is None:
            return ()
        return tuple(
            (s, fluid.separation_text(fluid.carried))
            for s, p in enumerate(self.steps.pressures)
            if fluid.separates(p)
        )

    def contact_states(
        self,
        take: Callable[[LoadState], Any],
        *,
        steps: LoadProgramme | None = None,
        memory: float | None = None,
        mapper: Mapper,
    ) -> Iterator[Any]:
        """Solve the contact of the whole surface at every step, with the fluid pressure where it acts.

        See `contact.load_states`.

        Parameters
        ----------
        take : makes the result of a step from its `LoadState`.
        steps : load programme; that of the scene unless given.
        memory : that a step takes [byte]; estimated unless given.
        mapper : computes a stage for many items.
        """
        gap0 = self.surface.heights.max() - self.surface.heights
        fluid = self.acting_fluid
        solve: Callable[..., Contact] = (
            solve_contact if fluid is None else partial(FluidPressure.contact, fluid)
        )
        if isinstance(self.surface, Patches):
            solve = partial(contact_of_patches, patches=self.surface, solve=solve, flow=self.flow)
        steps = self.steps if steps is None else steps
        return load_states(
            steps,
            contact_at_loads(gap0, self.half_space, steps, self.law, solve),
            rtol=self.rtol,
            take=take,
            remember=attrgetter("trapped") if self.traps_liquid else None,
            memory=8.0 * STATE_FIELDS * gap0.size if memory is None else memory,
            mapper=mapper,
        )

    @property
    def flow(self) -> FlowSettings:
        """How the flow through surfaces and their cells is solved."""
        drop = PressureDrop.of(self.fluid, self.inlet_pressure, self.outlet_pressure)
        return FlowSettings(self.solver, drop, getattr(self.layout, "spiral", None))

    def check_spiral(self) -> None:
        """Raise InputError if the lead of a spiral does not suit the surface, whose flow cannot follow its grooves."""
        if (spiral := self.flow.spiral) is not None:
            spiral.seam(self.surface.shape, self.surface.spacing)

    def entry_pressures(self, gaps: Iterable[Floats]) -> Array | None:
        """Compute the capillary entry pressure of the critical constriction of the gap at every step [Pa].

        Below this pressure the liquid does not enter; it is inf where the gap is closed. None for fluids that wet the
        surfaces.

        gaps : of every step, arrays (n1, n2) [m].
        """
        if np.isnan(capillary_entry_pressure(self.fluid, 1.0)):
            return None
        found = (
            critical_constriction(np.maximum(gap, 0.0), self.surface.spacing, sides="periodic")
            for gap in gaps
        )
        return np.array(
            [capillary_entry_pressure(self.fluid, 0.0 if c is None else c.gap) for c in found]
        )

    def leakage(self, seal: Seal, permeability: Any, rtol: float = 1e-5) -> Leakage:
        """Solve the leakage of a seal between the fluid pressures of the scene, see `seal_leakage`.

        Raises NotConverged: the linear solver failed.
        """
        return seal_leakage(
            seal,
            permeability,
            self.fluid,
            inlet_pressure=self.inlet_pressure,
            outlet_pressure=self.outlet_pressure,
            solver=self.solver,
            rtol=rtol,
        )

    @property
    def unit_leakage(self) -> float:
        """Leakage per length of a surface whose permeability is 1 m³ [1/(m s)]."""
        return FluidState.of(self).drop / self.surface.size[0]

    def pressure_at(self, potential: Floats) -> Array:
        """Compute the fluid pressure [Pa] of a potential that is 0 at the outlet and 1 at the inlet."""
        return pressure_between(self.fluid, self.inlet_pressure, self.outlet_pressure, potential)


@dataclass(frozen=True)
class FluidState:
    """A fluid with its pressures at the inlet and at the outlet [Pa], absolute for a gas."""

    fluid: Fluid
    inlet_pressure: float
    outlet_pressure: float

    @classmethod
    def of(cls, scene: Scene) -> Self:
        """Take the fluid of a scene."""
        return cls(scene.fluid, scene.inlet_pressure, scene.outlet_pressure)

    def in_scene(self, scene: Scene) -> Scene:
        """Return a scene with this fluid instead of its own."""
        return replace(
            scene,
            fluid=self.fluid,
            inlet_pressure=self.inlet_pressure,
            outlet_pressure=self.outlet_pressure,
        )

    @property
    def pressure_drop(self) -> float:
        """Size of the difference of both pressures [Pa]."""
        return abs(self.inlet_pressure - self.outlet_pressure)

    @property
    def law(self) -> FlowLaw:
        """Permeability of a gap for the fluid."""
        return law_of(self.fluid)

    @property
    def drop(self) -> float:
        """Drop of the potential over the reference density: volume rate for a conductance of 1 m³ [1/s]."""
        inlet, outlet = (
            float(self.fluid.potential(p)) for p in (self.inlet_pressure, self.outlet_pressure)
        )
        return (inlet - outlet) / self.fluid.reference_density
