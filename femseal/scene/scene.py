"""Describe the input of all studies: a rough surface, its loads, and the fluid that leaks."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from functools import partial
from operator import attrgetter
from typing import Any, Self

import numpy as np

from ..base import Array, Floats, InputError, Mapper, to_text
from ..contact import (
    STATE_FIELDS,
    Bodies,
    Contact,
    ContactLaw,
    HalfSpace,
    LoadState,
    checked_modulus,
    contact_at_loads,
    contact_law,
    load_states,
    solve_contact,
    surface_modulus,
)
from ..face.cell_flow import FlowSettings
from ..flow import critical_constriction
from ..flow.law import FlowLaw, law_of
from ..flow.pressure_drop import PressureDrop, pressure_between
from ..fluids import Fluid, Liquid, capillary_entry_pressure, potential_of
from ..loads import LoadProgramme
from ..materials import Coated
from ..seal import Leakage, seal_leakage
from ..seal.layouts import Layout, RectangularLayout
from ..seal.shapes import Seal
from ..topography import Patches, Topography
from .choices import FLUID_EFFECTS, NOMINALS
from .fluid_coupling import solve_coupled_contact
from .fluid_pressure import LEAST_FRACTION, FluidPressure
from .patch_contacts import contact_of_patches


@dataclass(frozen=True)
class Scene:
    """Describe the input of all studies: a rough surface, its loads, and the fluid that leaks.

    Parameters
    ----------
    surface : Topography, Patches, or list of Topography
        Combined heights of both faces; the highest points touch first. A list of `Topography` is converted to
        `Patches`, which are measured patches of the same surface. The contact of each patch is solved separately, and
        the flow through all patches is solved together.
    modulus : float or pair of bodies
        Contact modulus E* [Pa]; or the two bodies in contact, each a `Solid`, a `Coated`, or None for a rigid body, see
        `HalfSpace`.
    hardness : float, array or ContactLaw
        Hardness H of a perfectly plastic surface [Pa], infinite for an elastic surface; or a contact law such as
        `LinearHardening`.
    fluid : Fluid
        The fluid that leaks.
    inlet_pressure, outlet_pressure : float
        Fluid pressures at inlet and outlet [Pa].
    loading, unload_from, unloading : tuple of float
        Nominal pressures of the load cycle [Pa], see `LoadProgramme.of`.
    boundary : tuple of two str
        Contact boundary of the whole surface along x1 and x2, see `HalfSpace`.
    rtol : float
        Relative residual at which the contact solver stops, see `contact.solve_contact`.
    layout : Layout
        Shape of the seal in the stochastic study: `RectangularLayout`, `AnnularLayout` or `MeshLayout` of
        `femseal.seal`. In the other studies, the seal is a strip formed by the surface itself.
    solver : str
        Flow solver for cells and seals, see `flow.cell_permeability`.
    fluid_pressure : "acts", "trapped" or "ignored"
        With "acts", the fluid pressure acts on the surfaces (see `scene.fluid_coupling`). With "trapped", the fluid
        pressure acts on the surfaces, and liquid in closed pockets keeps its volume (see `scene.trapped_liquid`). With
        "ignored", the contact is solved without fluid pressure.
    nominal : "total" or "contact"
        With "total", contact and fluid together carry the nominal pressure. With "contact", the contact alone carries
        the nominal pressure. The choice matters only if the fluid pressure acts on the surfaces.
    surroundings : float or None
        Pressure around the seal [Pa], by default 1 atm for a gas and 0 for a liquid.
    body_yield_stress : float or None
        Yield stress [Pa] of the weaker body below its surface and below any coating; by default, the hardness divided
        by 2.8. The yield stress is used only for warnings.

    Examples
    --------
    >>> import femseal as fs
    >>> face = fs.self_affine((32, 64), (32e-6, 64e-6), hurst=0.8, rms_slope=0.2, roll_off=20e-6, rng=1)
    >>> scene = fs.Scene(face, 115e9, 3e9, fs.Liquid(1e-3), 1e6, 0.0, loading=(5e7, 2e8))
    >>> [step.name for step in scene.steps]
    ['loading 50 MPa', 'loading 200 MPa']
    """

    surface: Topography | Patches
    modulus: float | Bodies
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
    body_yield_stress: float | None = None

    def __post_init__(self) -> None:
        """Check that the parameters are valid and consistent."""
        if not isinstance(self.surface, Topography | Patches):
            object.__setattr__(self, "surface", Patches(self.surface))
        if not isinstance(self.modulus, float):
            object.__setattr__(self, "modulus", checked_modulus(self.modulus))
        for name, choices in (("fluid_pressure", FLUID_EFFECTS), ("nominal", NOMINALS)):
            if getattr(self, name) not in choices:
                raise InputError(name, getattr(self, name), f"one of {', '.join(choices)}")
        for name in ("inlet_pressure", "outlet_pressure"):
            potential_of(self.fluid, name, getattr(self, name))
        flow = self.flow  # raises InputError if the solver is unknown
        highest = max(self.inlet_pressure, self.outlet_pressure)
        hardness = float(np.min(self.law.yield_pressure()))
        if self.acting_fluid is not None and highest >= hardness:
            expected = f"less than the hardness, {to_text(hardness, 'Pa')}"
            raise InputError("inlet_pressure", to_text(highest, "Pa"), expected)
        if undefined := int(np.isnan(self.surface.heights).sum()):
            given = f"{undefined} of {self.surface.heights.size} points undefined"
            expected = (
                "a surface without undefined points: fill them first, see Topography.fill_undefined"
            )
            raise InputError("surface", given, expected)
        has_patches = isinstance(self.surface, Patches)
        can_trap = hasattr(self.fluid, "bulk_modulus") and not (has_patches or flow.spiral)
        if self.traps_liquid and not can_trap:
            given = "'trapped' with a gas, several patches or a spiral"
            expected = (
                "'acts' there: only a liquid can be trapped, in a single patch without a spiral lay"
            )
            raise InputError("fluid_pressure", given, expected)
        if isinstance(self.surface, Patches):
            self.surface.check_waves()

    @property
    def law(self) -> ContactLaw:
        """Contact law, which limits the pressure that the points of the surface can carry."""
        return contact_law(self.hardness)

    @property
    def surface_modulus(self) -> float:
        """Contact modulus [Pa] for waves that are much shorter than the thickness of any coating."""
        return surface_modulus(self.modulus)

    @property
    def coatings(self) -> tuple[Coated, ...]:
        """Those of the two bodies in contact that have a coating; empty if only a contact modulus is given."""
        if isinstance(self.modulus, float):
            return ()
        return tuple(body for body in self.modulus if isinstance(body, Coated))

    @property
    def steps(self) -> LoadProgramme:
        """Load programme."""
        return LoadProgramme.of(self.loading, self.unload_from, self.unloading)

    @property
    def half_space(self) -> HalfSpace:
        """Elastic half-space on the grid of the whole surface."""
        return HalfSpace(self.surface.shape, self.surface.spacing, self.modulus, self.boundary)

    @property
    def is_dry(self) -> bool:
        """Whether the fluid pressure on the surfaces is ignored."""
        return self.fluid_pressure == "ignored"

    @property
    def traps_liquid(self) -> bool:
        """Whether liquid in closed pockets keeps its volume."""
        return self.fluid_pressure == "trapped"

    def dry(self, **changes: Any) -> Self:
        """Return a copy of the scene in which the fluid pressure does not act on the surfaces.

        changes : further parameters of `Scene` that are replaced in the copy.
        """
        return replace(self, fluid_pressure="ignored", **changes)

    @property
    def acting_fluid(self) -> FluidPressure | None:
        """Fluid pressure that acts on the surfaces.

        The value is None if the fluid pressure does not act on the surfaces, or is too small to change the leakage.
        """
        # The pressure distribution in a liquid does not depend on a constant viscosity. With a viscosity of 1, stored
        # contact states can be used for liquids of all viscosities.
        acting = self.fluid
        if isinstance(acting, Liquid) and acting.pressure_viscosity == 0:
            acting = Liquid(1.0, bulk_modulus=acting.bulk_modulus)
        fluid = FluidPressure(
            acting,
            self.inlet_pressure,
            self.outlet_pressure,
            self.nominal,
            self.flow,
            self.surroundings,
            self.traps_liquid,
        )
        acts = not self.is_dry and abs(fluid.mean_if_separated) > LEAST_FRACTION * min(
            self.steps.pressures
        )
        return fluid if acts or self.traps_liquid else None

    @property
    def fluid_effect(self) -> str:
        """Part of a sentence that describes the effect of the fluid pressure on the contact."""
        if self.is_dry:
            return "its pressure on the surfaces is ignored"
        fluid = self.acting_fluid
        if fluid is None:
            return "it carries less than 0.01 % of every load, and is neglected: it changes leakage by less than 0.5 %"
        carried = to_text(abs(fluid.mean_if_separated), "Pa", 3)
        if fluid.mean_if_separated < 0:
            return f"it pulls the surfaces together with a mean pressure of {carried}"
        share = (
            "as a part of the load"
            if self.nominal == "total"
            else "in addition to the load on the contact"
        )
        smallest_load = min((p for p in self.steps.pressures if p > 0), default=np.inf)
        fraction = f"{fluid.mean_if_separated / smallest_load:.2g} times the smallest load"
        trapped = "; liquid in closed pockets keeps its volume" if fluid.trapped else ""
        return f"it pushes the surfaces apart, and carries about {carried}, {fraction}, {share}{trapped}"

    @property
    def separated_steps(self) -> tuple[tuple[int, str], ...]:
        """Load steps at which the fluid between separated surfaces would carry the whole load.

        Each item contains the index of a load step and an explanation. At the load steps listed here, the tiles of a
        stochastic seal are open. At the same load steps, a seal computed from the contact of the whole surface may be
        closed, because the contact is solved without the fluid pressure (see `scene.fluid_coupling`).
        """
        fluid = self.acting_fluid
        if fluid is None:
            return ()
        explanation = fluid.separation_text(fluid.mean_if_separated)
        return tuple(
            (number, explanation)
            for number, pressure in enumerate(self.steps.pressures)
            if fluid.separates(pressure)
        )

    def contact_states(
        self,
        take: Callable[[LoadState], Any],
        *,
        steps: LoadProgramme | None = None,
        memory: float | None = None,
        mapper: Mapper,
    ) -> Iterator[Any]:
        """Solve the contact of the whole surface at each load step, and yield a result for each load step.

        If the fluid pressure acts on the surfaces, contact and flow are solved together. See `contact.load_states`.

        Parameters
        ----------
        take : callable
            Function that computes the result of a load step from its `LoadState`.
        steps : LoadProgramme, optional
            Load programme, by default the load programme of the scene.
        memory : float, optional
            Memory [byte] that the solution of a load step needs; by default, an estimate.
        mapper : Mapper
            Function like `map`, which solves several load steps one after another or in parallel.
        """
        gap0 = self.surface.heights.max() - self.surface.heights
        fluid = self.acting_fluid
        solve: Callable[..., Contact] = solve_contact
        if fluid is not None:
            solve = partial(solve_coupled_contact, fluid)
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
        """Settings of the flow solver for the surface and its cells."""
        drop = PressureDrop.of_fluid(self.fluid, self.inlet_pressure, self.outlet_pressure)
        return FlowSettings(self.solver, drop, getattr(self.layout, "spiral", None))

    def check_spiral(self) -> None:
        """Raise InputError if the lead of a spiral lay does not fit the grid of the surface."""
        spiral = self.flow.spiral
        if spiral is not None:
            spiral.seam(self.surface.shape, self.surface.spacing)

    def entry_pressures(self, gaps: Iterable[Floats]) -> Array | None:
        """Compute the capillary entry pressure of the critical constriction at each load step.

        A liquid that does not wet the surfaces leaks only if its pressure exceeds the entry pressure.

        Parameters
        ----------
        gaps : iterable of arrays, (n1, n2)
            Gap at each load step [m].

        Returns
        -------
        array, (steps,), or None
            Capillary entry pressure [Pa], infinite if the gap is closed; None if the fluid wets the surfaces.
        """
        if np.isnan(capillary_entry_pressure(self.fluid, 1.0)):
            return None
        entry_pressures = []
        for gap in gaps:
            open_gap = np.maximum(gap, 0.0)
            junction = critical_constriction(open_gap, self.surface.spacing, sides="periodic")
            narrowest_gap = 0.0 if junction is None else junction.gap
            entry_pressures.append(capillary_entry_pressure(self.fluid, narrowest_gap))
        return np.array(entry_pressures)

    def leakage(self, seal: Seal, permeability: Any, rtol: float = 1e-5) -> Leakage:
        """Compute the leakage of a seal at the inlet and outlet pressures of the scene, see `seal_leakage`.

        If the seal does not accept the solver that is named for the cells, its own solver is chosen automatically.
        """
        return seal_leakage(
            seal,
            permeability,
            self.fluid,
            inlet_pressure=self.inlet_pressure,
            outlet_pressure=self.outlet_pressure,
            bounds=True,
            solver=self.solver if self.solver in seal.solvers else "auto",
            rtol=rtol,
        )

    @property
    def unit_leakage(self) -> float:
        """Leakage per unit seal length for a permeability of 1 m³ [1/(m s)]; the seal is as wide as the surface."""
        return FluidState.of(self).drop / self.surface.size[0]

    def pressure_at(self, potential: Floats) -> Array:
        """Convert a potential, scaled to 0 at the outlet and 1 at the inlet, to the fluid pressure [Pa]."""
        return pressure_between(self.fluid, self.inlet_pressure, self.outlet_pressure, potential)


@dataclass(frozen=True)
class FluidState:
    """Describe a fluid and its pressures at inlet and outlet [Pa]. For a gas, pressures are absolute."""

    fluid: Fluid
    inlet_pressure: float
    outlet_pressure: float

    @classmethod
    def of(cls, scene: Scene) -> Self:
        """Return the fluid of a `Scene`, and the fluid pressures at inlet and outlet."""
        return cls(scene.fluid, scene.inlet_pressure, scene.outlet_pressure)

    def in_scene(self, scene: Scene) -> Scene:
        """Return a copy of a `Scene` with the fluid and the inlet and outlet pressures of this object."""
        return replace(
            scene,
            fluid=self.fluid,
            inlet_pressure=self.inlet_pressure,
            outlet_pressure=self.outlet_pressure,
        )

    @property
    def pressure_drop(self) -> float:
        """Absolute value of the difference between inlet and outlet pressure [Pa]."""
        return abs(self.inlet_pressure - self.outlet_pressure)

    @property
    def law(self) -> FlowLaw:
        """Flow law that gives the permeability of a gap for this fluid."""
        return law_of(self.fluid)

    @property
    def drop(self) -> float:
        """Drop of the pressure potential from inlet to outlet, divided by the reference density of the fluid [1/s].

        The volume flow rate through a seal is `drop` times the conductance of the seal [m³].
        """
        inlet, outlet = (
            float(self.fluid.potential(p)) for p in (self.inlet_pressure, self.outlet_pressure)
        )
        return (inlet - outlet) / self.fluid.reference_density
