"""Solve contact and flow together if the fluid pressure acts on the surfaces.

The traction between the surfaces is t = p + p_f, the sum of contact pressure p >= 0 and fluid pressure p_f. Let p̄ be
the nominal pressure. For a given p_f, the contact problem with the undeformed gap h₁ + K p_f and the load p̄ −
mean(p_f) gives the gap (see `contact.solve_contact`). For a given gap, the flow problem gives p_f. Contact and flow are
solved in turn until the permeability no longer changes. If no contact pressure can balance p̄, the surfaces separate.

p_f is measured relative to the pressure of the surroundings, which acts on the outside of the bodies. In contact areas,
and in pockets without flow, p_f is interpolated by Laplace's equation Δp_f = 0 from the pressures around these areas.

If the surface consists of several measured patches, the contact of each patch is solved separately, and the flow
through all patches is solved together.

Source: Shvarts & Yastrebov, J. Mech. Phys. Solids 119, 2018, 140.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..base import Array, InputError, Shape, to_text
from ..contact import Contact, ContactLaw, HalfSpace, contact_law, solve_contact
from ..face.cell_flow import FaceFlow, Failed, FlowSettings, attempt, solve_surface_flow
from ..flow.harmonic import harmonic_fill
from ..flow.pressure_drop import pressure_between
from ..fluids import Fluid
from ..topography import Patches
from .trapped_liquid import TrappedLiquid, liquid_in_pockets

#: The iteration of contact and flow stops at this relative change of the permeability, or after this number of rounds.
#: On self-affine and turned surfaces of 256² points with p̄/H from 0.02 to 0.2, the iteration took two to five rounds
#: for p_in/p̄ up to 0.3, and at most six rounds for p_in/p̄ up to 1. With trapped liquid that lifts the rims of its
#: pockets, it took up to 25 rounds.
RTOL, MOST_ROUNDS = 1e-3, 60
#: The fluid pressure is ignored if its mean is below this fraction of the nominal pressure, because such a pressure
#: changes the leakage by less than 0.5 %.
LEAST_FRACTION = 1e-4
#: Number of points at which a pressure profile is averaged.
_POINTS = 201
#: Largest fraction of the nominal pressure that the fluid carries in the first round.
_FIRST_CARRIED = 0.9
#: If less than this fraction of the nominal pressure is left to the contact, the iteration stops, and the load at which
#: the surfaces separate is determined instead.
_LEAST_CONTACT_SHARE = 0.01
#: Contact loads, as fractions of the inlet pressure, between which the smallest nominal pressure is bracketed.
_FIRST_LOADS = np.array([1e-4, 1e-2, 1e-1])
#: Factor between successive contact loads in the search for an upper bracket.
_LOAD_FACTOR = 3.0
#: Relative error of the contact load in the search for the nominal pressure.
_LOAD_RTOL = 1e-4
#: Factor by which the tolerance of the iteration is multiplied during the search for the nominal pressure.
_SEARCH_TOLERANCE = 0.1
#: Number of rounds without flow after which a surface with trapped liquid counts as closed.
_CLOSED_ROUNDS = 4
#: Number of rounds after which the pressure of trapped liquid may only decrease, so that the iteration ends.
_RELEASE_ROUNDS = 25
#: Largest pressure of trapped liquid, as a fraction of the hardness. Excess liquid escapes, because the metal around a
#: pocket yields if the pressure of the liquid reaches the hardness.
_MOST_OF_HARDNESS = 0.9


@dataclass(frozen=True, kw_only=True)
class CoupledContact(Contact):
    """Solution of a contact in equilibrium with the fluid pressure of the flow through its gap.

    Attributes
    ----------
    flow : FaceFlow or Failed
        Flow through the gap. In two cases, it is a `Failed` object that states the reason. In the first
        case, the surfaces separate, and `contact` is the solution for surfaces that just touch. In the second case, the
        iteration did not converge, and `contact` is the solution of its last round.
    carried : float
        Mean pressure that the fluid carries [Pa].
    rounds : int
        Number of times that contact and flow were solved.
    trapped : TrappedLiquid or None
        Liquid that keeps its volume in closed pockets; None if trapped liquid is not considered.
    """

    flow: FaceFlow | Failed
    carried: float
    rounds: int
    trapped: TrappedLiquid | None = None


@dataclass(frozen=True)
class FluidPressure:
    """Describe a fluid whose pressure acts on the surfaces, and solve the contact under this pressure.

    Attributes
    ----------
    fluid : Fluid
        Fluid with its viscosity and density.
    inlet, outlet : float
        Fluid pressures at inlet and outlet [Pa].
    nominal : "total" or "contact"
        Whether the nominal pressure is carried by contact and fluid together, or by the contact alone.
    settings : FlowSettings
        Settings of the flow solver.
    surroundings : float or None
        Pressure around the seal [Pa], see `Scene`.
    trapped : bool
        Whether liquid in closed pockets keeps its volume.
    """

    fluid: Fluid
    inlet: float
    outlet: float
    nominal: str
    settings: FlowSettings
    surroundings: float | None = None
    trapped: bool = False

    @property
    def _ambient(self) -> float:
        """Pressure of the surroundings [Pa]; an absolute pressure if the fluid is a gas."""
        if self.surroundings is None:
            return float(getattr(self.fluid, "outlet_pressure", 0.0))
        return self.surroundings

    def above_surroundings(self, fraction: Any) -> Array:
        """Convert a pressure potential, scaled to 1 at the inlet and 0 at the outlet, to a fluid pressure [Pa].

        The fluid pressure is relative to the pressure of the surroundings.
        """
        pressure = pressure_between(self.fluid, self.inlet, self.outlet, fraction)
        return np.asarray(pressure) - self._ambient

    @property
    def carried(self) -> float:
        """Mean fluid pressure between separated surfaces [Pa], relative to the surroundings.

        The gap between separated surfaces is assumed to be uniform, so that the pressure potential is linear.
        """
        return float(self.above_surroundings((np.arange(_POINTS) + 0.5) / _POINTS).mean())

    @property
    def mean(self) -> float:
        """Mean fluid pressure for a pressure potential that falls linearly from inlet to outlet [Pa]."""
        return self.carried + self._ambient

    def relief(self, pressure: Any) -> Array:
        """Compute by how much the fluid pressure reduces the contact pressure of a cell [Pa].

        The contact of a cell is solved for dry surfaces under the effective pressure p̄ − p_f (Terzaghi's effective
        stress). If the seal is wide compared with the long waves of the surface, the coupled solution of contact and
        flow approaches the effective-pressure solution.

        Parameters
        ----------
        pressure : float or array
            Fluid pressure in the cell [Pa].
        """
        carried_beside_contact = 0.0 if self.nominal == "total" else self.carried
        return np.asarray(pressure, dtype=float) - self._ambient - carried_beside_contact

    def separates(self, pressure: float) -> bool:
        """Return whether the fluid between separated surfaces would carry the whole nominal pressure [Pa]."""
        return self.nominal == "total" and self.carried >= pressure

    @staticmethod
    def separation_text(carried: float) -> str:
        """Return a text that explains why the surfaces separate: the fluid carries the mean pressure `carried` [Pa]."""
        limit = to_text(carried, "Pa", 3)
        return f"open: the surfaces separate below {limit}, all of which the fluid carries"

    def contact(
        self,
        gap0: Array,
        half_space: HalfSpace,
        *,
        pressure: float,
        remembered: TrappedLiquid | None = None,
        tolerance_factor: float = 1.0,
        **settings: Any,
    ) -> Contact | CoupledContact:
        """Solve contact and flow in turn until the permeability no longer changes.

        If the fluid carries less than 1e-4 of the load and no liquid is trapped, only the contact is solved.

        Parameters
        ----------
        gap0 : array, (n1, n2)
            Undeformed gap h₁ [m]: gap between the undeformed surfaces when they first touch.
        half_space : HalfSpace
            Elastic body and grid.
        pressure : float
            Nominal pressure [Pa].
        remembered : TrappedLiquid or None
            Trapped liquid at the previous load; None at the first load.
        tolerance_factor : float
            Factor by which the tolerance of the iteration is multiplied.
        settings : dict
            Other arguments of `solve_contact`.

        Raises
        ------
        NotConverged
            The contact solver failed.
        """
        if abs(self.carried) <= LEAST_FRACTION * pressure and not self.trapped:
            return solve_contact(gap0, half_space, pressure=pressure, **settings)
        law = contact_law(settings.get("hardness", np.inf))
        highest_trapped = _MOST_OF_HARDNESS * float(np.min(law.yield_pressure()))
        applied = self._first_pressure(half_space.shape, pressure, remembered, highest_trapped)
        previous: _Round | None = None
        step = 1.0  # fraction of the proposed change of the fluid pressure that is applied
        change = 1.0
        for number in range(1, MOST_ROUNDS + 1):
            solved = self._round(gap0, half_space, pressure, applied, settings)
            if isinstance(solved.flow, Failed):
                return solved.coupled_contact(number)
            if self.trapped:
                solved = self._with_trapped_liquid(
                    solved,
                    previous,
                    remembered,
                    pressure,
                    highest_pressure=highest_trapped,
                    only_falls=number > _RELEASE_ROUNDS,
                )
            change = solved.change(previous, step, max(abs(self.inlet), abs(self.outlet)))
            if change <= tolerance_factor * RTOL:
                return solved.coupled_contact(number)
            left_to_contact = self._left_to_contact(pressure, applied)
            if left_to_contact <= _LEAST_CONTACT_SHARE * pressure:
                return self._near_opening(gap0, half_space, pressure, settings)
            applied, step = _next_pressure(solved, previous, left_to_contact)
            previous = solved
        reason = f"contact and fluid pressure: after {number} rounds the permeability still changes by {change:.1e}"
        return replace(solved, flow=Failed(reason), trapped=None).coupled_contact(number)

    def _first_pressure(
        self,
        shape: Shape,
        pressure: float,
        previous_liquid: TrappedLiquid | None,
        highest_trapped: float,
    ) -> Array:
        """Choose the fluid pressure (n1, n2) [Pa] of the first round of the iteration.

        The pressure corresponds to a pressure potential that falls linearly from inlet to outlet. If this fluid
        pressure would carry nearly the whole load, it is reduced so that the contact carries part of the load.

        Parameters
        ----------
        shape : tuple of two int
            Numbers of points.
        pressure : float
            Nominal pressure [Pa].
        previous_liquid : TrappedLiquid or None
            Trapped liquid at the previous load.
        highest_trapped : float
            Largest pressure of trapped liquid [Pa].
        """
        applied = self.linear_drop(shape)
        if previous_liquid is not None:
            # first guess for trapped liquid: its pressure rises as much as the nominal pressure
            increase = pressure - previous_liquid.load
            with_liquid = previous_liquid.insert_into(applied, increase)
            applied = np.minimum(with_liquid, highest_trapped)
        carried = float(applied.mean())
        if self.nominal == "total" and carried > _FIRST_CARRIED * pressure:
            applied = applied * (_FIRST_CARRIED * pressure / carried)
        return applied

    def _left_to_contact(self, pressure: float, applied: Array) -> float:
        """Compute the contact load [Pa] that remains under the applied fluid pressure (n1, n2) [Pa].

        The contact load is the nominal pressure minus the mean fluid pressure. If the nominal pressure refers to the
        contact alone, the fluid cannot reduce the contact load, and the result is infinity.
        """
        if self.nominal == "contact":
            return np.inf
        return pressure - float(applied.mean())

    def _round(
        self,
        gap0: Array,
        half_space: HalfSpace,
        pressure: float,
        applied: Array,
        settings: Mapping[str, Any],
    ) -> _Round:
        """Solve the contact under the applied fluid pressure (n1, n2) [Pa], then the flow through the resulting gap."""
        load = pressure
        if self.nominal == "contact":
            load = max(pressure + float(applied.mean()), 0.0)
        contact = solve_contact(gap0, half_space, pressure=load, fluid_pressure=applied, **settings)
        flow = attempt(solve_surface_flow, contact.gap, half_space.spacing, self.settings)
        resulting = applied if isinstance(flow, Failed) else self._pressure_of_flow(flow, applied)
        return _Round(applied, contact, flow, resulting)

    def _with_trapped_liquid(
        self,
        solved: _Round,
        previous: _Round | None,
        previous_liquid: TrappedLiquid | None,
        pressure: float,
        *,
        highest_pressure: float,
        only_falls: bool,
    ) -> _Round:
        """Add the pressure of trapped liquid, in pockets without flow, to the result of a round of the iteration.

        Parameters
        ----------
        solved, previous : _Round
            Results of the present round and of the previous round; `previous` is None in the first round.
        previous_liquid : TrappedLiquid or None
            Trapped liquid at the previous load.
        pressure : float
            Nominal pressure [Pa].
        highest_pressure : float
            Largest pressure of trapped liquid [Pa].
        only_falls : bool
            If True, the pressure of trapped liquid can only decrease, so that the iteration terminates.
        """
        assert isinstance(solved.flow, FaceFlow)
        is_open = solved.contact.gap > 0
        is_pocket = np.isnan(solved.flow.potential) & is_open  # open points without flow
        trapped = liquid_in_pockets(
            previous_liquid,
            solved.contact.half_space,
            solved.contact.gap,
            is_pocket,
            applied=solved.applied,
            surrounding=solved.resulting,
            bulk_modulus=getattr(self.fluid, "bulk_modulus", None) or np.inf,
            highest_pressure=highest_pressure,
            load=pressure,
            only_falls=only_falls,
        )
        resulting = solved.resulting
        if is_open.any():
            # mark contact areas by NaN, which `harmonic_fill` replaces by interpolating the pressures around them
            open_pressure = trapped.insert_into(solved.resulting)
            resulting = harmonic_fill(np.where(is_open, open_pressure, np.nan))
        closed_rounds = 0
        highest = float(np.abs(resulting).max())
        if solved.flow.permeability == 0:
            closed_rounds = 1 if previous is None else previous.closed_rounds + 1
        if previous is not None:
            highest = max(previous.highest, highest)
        return replace(
            solved,
            resulting=resulting,
            trapped=trapped,
            closed_rounds=closed_rounds,
            highest=highest,
        )

    def _near_opening(
        self, gap0: Array, half_space: HalfSpace, pressure: float, settings: Mapping[str, Any]
    ) -> CoupledContact:
        """Solve the contact at a nominal pressure [Pa] at which the surfaces separate or nearly separate.

        For a prescribed contact load, the coupled problem of contact and flow always has a solution. The nominal
        pressure is the sum of the contact load and the mean pressure of the fluid. The function therefore prescribes
        the contact load, and varies it until the nominal pressure has the given value.

        As a function of the contact load, the nominal pressure has a minimum. If the given nominal pressure is less
        than the minimum, the surfaces separate. If the given nominal pressure is larger than the minimum, two contact
        loads give this nominal pressure. The larger contact load is chosen, because the seal reaches it first when the
        load is reduced or the fluid pressure is raised. Trapped liquid is ignored.
        """
        from scipy.optimize import brentq

        solution_by_load: dict[float, Any] = {}  # coupled contact for each contact load
        with_contact_load = replace(self, nominal="contact", trapped=False)

        def nominal_pressure(load: float) -> float:
            """Solve contact and flow for a contact load, or use the stored solution; return the nominal pressure."""
            if load not in solution_by_load:
                solution_by_load[load] = with_contact_load.contact(
                    gap0, half_space, pressure=load, tolerance_factor=_SEARCH_TOLERANCE, **settings
                )
            return load + solution_by_load[load].carried

        loads = (_FIRST_LOADS * max(abs(self.inlet), abs(self.outlet))).tolist()
        load_at_minimum, minimum = _minimum_over_loads(nominal_pressure, loads)
        if pressure > minimum:
            # find the contact load above the minimum that belongs to the nominal pressure
            upper = load_at_minimum
            while nominal_pressure(upper) < pressure:
                upper *= _LOAD_FACTOR
            load = brentq(
                lambda load: nominal_pressure(load) - pressure,
                upper / _LOAD_FACTOR,
                upper,
                rtol=_LOAD_RTOL,
            )
            return solution_by_load[load]
        # the surfaces separate: return the contact at first touch under the pressure of a linear potential
        applied = self.linear_drop(half_space.shape)
        contact = solve_contact(
            gap0, half_space, pressure=float(applied.mean()), fluid_pressure=applied, **settings
        )
        rounds = sum(solution.rounds for solution in solution_by_load.values())
        flow = Failed(self.separation_text(minimum))
        return CoupledContact(**vars(contact), flow=flow, carried=pressure, rounds=rounds)

    def _pressure_of_flow(self, flow: FaceFlow, applied: Array) -> Array:
        """Compute the fluid pressure (n1, n2) [Pa] of a flow relative to the surroundings, also in contact areas.

        If no fluid flows through the gap, the pressure `applied` is returned.
        """
        pressure = harmonic_fill(self.above_surroundings(flow.potential))
        return pressure if np.isfinite(pressure).all() else applied

    def linear_drop(self, shape: Shape) -> Array:
        """Compute the fluid pressure (n1, n2) [Pa] for a pressure potential that falls linearly along x1.

        The fluid pressure is relative to the pressure of the surroundings.
        """
        n1, n2 = shape
        fraction = 1 - (np.arange(n1) + 0.5) / n1
        return np.repeat(self.above_surroundings(fraction)[:, None], n2, axis=1)


@dataclass(frozen=True, eq=False)
class _Round:
    """Solutions of contact and flow in one round of the iteration.

    Attributes
    ----------
    applied : array, (n1, n2)
        Fluid pressure under which the contact was solved [Pa].
    contact : Contact
        Solution of the contact.
    flow : FaceFlow or Failed
        Flow through the gap of the contact.
    resulting : array, (n1, n2)
        Fluid pressure that results from `flow`, including the pressure of trapped liquid in pockets [Pa].
    trapped : TrappedLiquid or None
        Trapped liquid; None if trapped liquid is not considered.
    closed_rounds : int
        Number of rounds without flow since the last round with flow, for a surface with trapped liquid.
    highest : float
        Highest fluid pressure [Pa] in any round so far, for a surface with trapped liquid.
    """

    applied: Array
    contact: Contact
    flow: FaceFlow | Failed
    resulting: Array
    trapped: TrappedLiquid | None = None
    closed_rounds: int = 0
    highest: float = 0.0

    def coupled_contact(self, rounds: int) -> CoupledContact:
        """Return contact and flow of this round as the result of the iteration, which took `rounds` rounds."""
        return CoupledContact(
            **vars(self.contact),
            flow=self.flow,
            carried=float(self.applied.mean()),
            rounds=rounds,
            trapped=self.trapped,
        )

    def change(self, previous: _Round | None, step: float, scale: float) -> float:
        """Compute the relative change since the previous round, which decides when the iteration stops.

        In the first round, the change is infinite. In all other rounds, the relative change of the permeability is
        returned. If no fluid flows through the gap in either round, the permeability is 0, and the function returns the
        change of the fluid pressure relative to the highest fluid pressure instead. If trapped liquid has kept the gap
        closed for several rounds, the change of the fluid pressure is ignored. With trapped liquid, the returned value
        is at least the relative error of the volume of the liquid.

        Parameters
        ----------
        previous : _Round or None
            Previous round; None in the first round.
        step : float
            Fraction of the proposed change of fluid pressure that was applied.
        scale : float
            Larger absolute value of the fluid pressures at inlet and outlet [Pa].
        """
        if previous is None:
            return np.inf
        assert isinstance(self.flow, FaceFlow)
        assert isinstance(previous.flow, FaceFlow)
        before = previous.flow.permeability
        now = self.flow.permeability
        if self.trapped is not None and self.closed_rounds >= _CLOSED_ROUNDS:
            change = 0.0
        elif before:
            # the whole proposed change of the fluid pressure would have changed the permeability by more
            change = abs(now / before - 1) / step
        elif now:
            change = np.inf
        else:
            row_change = (self.resulting - self.applied).mean(axis=1)
            change = float(np.abs(row_change).max()) / max(scale, self.highest)
        if self.trapped is None:
            return change
        return max(change, self.trapped.error)


def _next_pressure(
    solved: _Round, previous: _Round | None, left_to_contact: float
) -> tuple[Array, float]:
    """Choose the fluid pressure (n1, n2) [Pa] of the next round of the iteration.

    The proposed fluid pressure is a mixture of the fluid pressures of the last two rounds. If the proposed fluid
    pressure would carry the whole load, only a fraction of the change from the present to the proposed pressure is
    applied. The fraction is chosen so that the mean fluid pressure increases by one half of the present contact load.

    left_to_contact : present contact load, averaged over the surface [Pa].

    Returns the fluid pressure, and the fraction of the change that is applied.
    """
    proposed = _mixed_pressure(solved, previous)
    if solved.trapped is not None:
        proposed = solved.trapped.insert_into(proposed)
    increase = float(proposed.mean()) - float(solved.applied.mean())
    if increase < left_to_contact:
        return proposed, 1.0
    step = 0.5 * left_to_contact / increase
    return solved.applied + step * (proposed - solved.applied), step


def _mixed_pressure(solved: _Round, previous: _Round | None) -> Array:
    """Mix the resulting fluid pressures of the last two rounds by Anderson mixing of depth one.

    The residual of a round is the difference between the resulting and the applied fluid pressure, averaged over each
    row of the grid. Let r be the residual of the present round and r' the residual of the previous round. The result is
    the mean of the fluid pressures of the two rounds with the weights 1 − w and w. The weight w minimises
    |(1 − w) r + w r'|.

    Mixing damps oscillations. Without mixing, the fluid pressure oscillates if the surfaces are nearly sealed: it is
    too high in one round, and too low in the next round.
    """
    if previous is None:
        return solved.resulting
    residual = (solved.resulting - solved.applied).mean(axis=1)
    previous_residual = (previous.resulting - previous.applied).mean(axis=1)
    difference = residual - previous_residual
    squared = float(difference @ difference)
    if squared == 0 or not previous_residual.any():
        return solved.resulting
    # minimum of |r − w (r − r')|², limited so that the last round has at least the weight of the previous round
    weight = float(np.clip(residual @ difference / squared, 0.0, 0.5))
    return (1 - weight) * solved.resulting + weight * previous.resulting


def _minimum_over_loads(
    nominal_pressure: Callable[[float], float], loads: list[float]
) -> tuple[float, float]:
    """Find the contact load at which the nominal pressure is smallest; return this load and the nominal pressure [Pa].

    nominal_pressure : function that computes the nominal pressure [Pa] for a contact load [Pa].
    loads : increasing contact loads [Pa], among which the minimum is bracketed.
    """
    from scipy.optimize import minimize_scalar

    nominal_pressures = [nominal_pressure(load) for load in loads]
    lowest = int(np.argmin(nominal_pressures))
    if lowest == 0:
        return loads[0], nominal_pressures[0]
    # search between the neighbours of the best load, on a logarithmic scale
    bracket = np.log([loads[lowest - 1], loads[min(lowest + 1, len(loads) - 1)]])
    optimum = minimize_scalar(
        lambda log_load: nominal_pressure(float(np.exp(log_load))),
        bounds=bracket,
        method="bounded",
        options={"xatol": 0.3},
    )
    return float(np.exp(optimum.x)), float(optimum.fun)


def contact_of_patches(
    gap0: Array,
    half_space: HalfSpace,
    *,
    patches: Patches,
    solve: Callable[..., Contact],
    flow: FlowSettings,
    hardness: ContactLaw,
    deformation: Array | None = None,
    **settings: Any,
) -> Contact:
    """Solve the contact of each measured patch under the same nominal pressure, and join the results side by side.

    If the fluid pressure acts on the patches, the flow through all patches together is solved in the joined gap.

    Parameters
    ----------
    gap0, half_space, hardness, deformation, settings
        Arguments of `solve`; the arrays contain all patches side by side along x2.
    patches : Patches
        The surface, which consists of several measured patches.
    solve : callable
        Function that solves the contact of a single patch.
    flow : FlowSettings
        Settings for the flow through all patches.

    Raises
    ------
    InputError
        The contact law differs from point to point.
    NotConverged
        The contact solver failed.
    """
    if not hardness.is_uniform:
        given = "a contact law that varies over the surface, with several patches"
        raise InputError("hardness", given, "the same contact law at all points of all patches")
    patch_deformations: Iterable[Array | None]
    if deformation is None:
        patch_deformations = [None] * len(patches.widths)
    else:
        patch_deformations = patches.split(deformation)
    contacts = []
    for gap, patch_deformation in zip(patches.split(gap0), patch_deformations, strict=True):
        body = replace(half_space, shape=gap.shape)
        # the gap of first touch is 0 at the highest point of each patch
        patch_gap = np.ascontiguousarray(gap - gap.min())
        contact = solve(
            patch_gap, body, hardness=hardness, deformation=patch_deformation, **settings
        )
        contacts.append(contact)
    joined: dict[str, Any] = {
        "approach": float(np.average([c.approach for c in contacts], weights=patches.widths)),
        "residual": max(c.residual for c in contacts),
        "iterations": max(c.iterations for c in contacts),
        "fft_pairs": sum(c.fft_pairs for c in contacts),
        "half_space": half_space,
    }
    for name in ("pressure", "gap", "plastic_deformation", "plastic"):
        patch_fields = [getattr(c, name) for c in contacts]
        joined[name] = np.concatenate(patch_fields, axis=1)
    coupled = [c for c in contacts if isinstance(c, CoupledContact)]
    if not coupled:
        return Contact(**joined)
    carried = [getattr(c, "carried", 0.0) for c in contacts]
    joined_flow = attempt(solve_surface_flow, joined["gap"], half_space.spacing, flow)
    failed = [c.flow for c in coupled if isinstance(c.flow, Failed)]
    return CoupledContact(
        **joined,
        flow=failed[0] if failed else joined_flow,
        carried=float(np.average(carried, weights=patches.widths)),
        rounds=max(c.rounds for c in coupled),
    )
