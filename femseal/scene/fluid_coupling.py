"""Solve contact and flow together if the fluid pressure acts on the surfaces.

The traction between the surfaces is t = p + p_f, the sum of contact pressure p >= 0 and fluid pressure p_f. Let p̄ be
the nominal pressure. For a given p_f, the contact problem with the undeformed gap h₁ + K p_f and the load p̄ −
mean(p_f) gives the gap (see `contact.solve_contact`). For a given gap, the flow problem gives p_f. Contact and flow are
solved in turn until the permeability no longer changes. If no contact pressure can balance p̄, the surfaces separate.

In contact areas, and in pockets without flow, p_f is interpolated by Laplace's equation Δp_f = 0 from the pressures
around these areas.

Source: Shvarts & Yastrebov, J. Mech. Phys. Solids 119, 2018, 140.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from ..base import Array
from ..contact import Contact, HalfSpace, contact_law, solve_contact
from ..face.cell_flow import FaceFlow, Failed, attempt, solve_surface_flow
from ..flow.harmonic import harmonic_fill
from .fluid_pressure import LEAST_FRACTION, FluidPressure
from .separation import find_contact_load
from .trapped_liquid import TrappedLiquid, liquid_in_pockets

#: The iteration of contact and flow stops at this relative change of the permeability, or after this number of rounds.
#: On self-affine and turned surfaces of 256² points with p̄/H from 0.02 to 0.2, the iteration took two to five rounds
#: for p_in/p̄ up to 0.3, and at most six rounds for p_in/p̄ up to 1. With trapped liquid that lifts the rims of its
#: pockets, it took up to 25 rounds.
COUPLING_RTOL, MOST_ROUNDS = 1e-3, 60
#: Largest fraction of the nominal pressure that the fluid carries in the first round.
_FIRST_CARRIED = 0.9
#: If less than this fraction of the nominal pressure is left to the contact, the iteration stops, and the load at which
#: the surfaces separate is determined instead.
_LEAST_CONTACT_SHARE = 0.01
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


def solve_coupled_contact(
    fluid: FluidPressure,
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
    fluid : FluidPressure
        Fluid whose pressure acts on the surfaces.
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
    if abs(fluid.mean_if_separated) <= LEAST_FRACTION * pressure and not fluid.trapped:
        return solve_contact(gap0, half_space, pressure=pressure, **settings)
    problem = _CoupledProblem(fluid, gap0, half_space, pressure, remembered, settings)
    applied = problem.first_pressure()
    step = 1.0  # fraction of the proposed change of the fluid pressure that is applied
    previous: _Round | None = None
    for number in range(1, MOST_ROUNDS + 1):
        solved = problem.solve_round(number, applied, previous)
        if isinstance(solved.flow, Failed):
            return solved.coupled_contact()
        change = solved.change(previous, step, fluid.largest)
        if change <= tolerance_factor * COUPLING_RTOL:
            return solved.coupled_contact()
        left_to_contact = problem.left_to_contact(applied)
        if left_to_contact <= _LEAST_CONTACT_SHARE * pressure:
            return problem.solve_near_separation()
        applied, step = _next_pressure(solved, previous, left_to_contact)
        previous = solved
    reason = f"contact and fluid pressure: after {number} rounds the permeability still changes by {change:.1e}"
    return replace(solved, flow=Failed(reason), trapped=None).coupled_contact()


@dataclass(frozen=True, eq=False)
class _CoupledProblem:
    """Contact under the pressure of the fluid that flows through its gap.

    Attributes
    ----------
    fluid, gap0, half_space, pressure, settings
        Arguments of `solve_coupled_contact`.
    previous_liquid : TrappedLiquid or None
        Trapped liquid at the previous load; None at the first load.
    """

    fluid: FluidPressure
    gap0: Array
    half_space: HalfSpace
    pressure: float
    previous_liquid: TrappedLiquid | None
    settings: Mapping[str, Any]

    @cached_property
    def highest_trapped(self) -> float:
        """Largest pressure of trapped liquid [Pa]."""
        law = contact_law(self.settings.get("hardness", np.inf))
        return _MOST_OF_HARDNESS * float(np.min(law.yield_pressure()))

    def first_pressure(self) -> Array:
        """Choose the fluid pressure (n1, n2) [Pa] of the first round of the iteration.

        The pressure corresponds to a pressure potential that falls linearly from inlet to outlet. If this fluid
        pressure would carry nearly the whole load, it is reduced so that the contact carries part of the load.
        """
        applied = self.fluid.linear_drop(self.half_space.shape)
        if self.previous_liquid is not None:
            # first guess for trapped liquid: its pressure rises as much as the nominal pressure
            increase = self.pressure - self.previous_liquid.load
            with_liquid = self.previous_liquid.insert_into(applied, increase)
            applied = np.minimum(with_liquid, self.highest_trapped)
        carried = float(applied.mean())
        if self.fluid.carrier == "total" and carried > _FIRST_CARRIED * self.pressure:
            applied = applied * (_FIRST_CARRIED * self.pressure / carried)
        return applied

    def left_to_contact(self, applied: Array) -> float:
        """Compute the contact load [Pa] that remains under the applied fluid pressure (n1, n2) [Pa].

        The contact load is the nominal pressure minus the mean fluid pressure. If the nominal pressure refers to the
        contact alone, the fluid cannot reduce the contact load, and the result is infinity.
        """
        if self.fluid.carrier == "contact":
            return np.inf
        return self.pressure - float(applied.mean())

    def solve_round(self, number: int, applied: Array, previous: _Round | None) -> _Round:
        """Solve the contact under a fluid pressure, then the flow through the resulting gap and its fluid pressure.

        Parameters
        ----------
        number : int
            Number of the round, from 1.
        applied : array, (n1, n2)
            Fluid pressure [Pa].
        previous : _Round or None
            Previous round; None in the first round.
        """
        load = self.pressure
        if self.fluid.carrier == "contact":
            load = max(self.pressure + float(applied.mean()), 0.0)
        contact = self._solve_contact(load, applied)
        flow = attempt(
            solve_surface_flow, contact.gap, self.half_space.spacing, self.fluid.settings
        )
        if isinstance(flow, Failed):
            return _Round(number, applied, contact, flow, applied)
        resulting = self._pressure_of_flow(flow, applied)
        solved = _Round(number, applied, contact, flow, resulting)
        return self._with_trapped_liquid(solved, previous) if self.fluid.trapped else solved

    def _solve_contact(self, load: float, applied: Array) -> Contact:
        """Solve the contact under a load [Pa] and a fluid pressure (n1, n2) [Pa]."""
        return solve_contact(
            self.gap0, self.half_space, pressure=load, fluid_pressure=applied, **self.settings
        )

    def _pressure_of_flow(self, flow: FaceFlow, applied: Array) -> Array:
        """Compute the fluid pressure (n1, n2) [Pa] of a flow relative to the surroundings, also in contact areas.

        If no fluid flows through the gap, the pressure `applied` is returned.
        """
        pressure = harmonic_fill(self.fluid.above_surroundings(flow.potential))
        return pressure if np.isfinite(pressure).all() else applied

    def _with_trapped_liquid(self, solved: _Round, previous: _Round | None) -> _Round:
        """Add the pressure of trapped liquid, in pockets without flow, to the result of a round of the iteration.

        solved, previous : results of the present round and of the previous round; `previous` is None in the first
            round.
        """
        assert isinstance(solved.flow, FaceFlow)
        is_open = solved.contact.gap > 0
        is_pocket = np.isnan(solved.flow.potential) & is_open  # open points without flow
        trapped = liquid_in_pockets(
            self.previous_liquid,
            solved.contact.half_space,
            solved.contact.gap,
            is_pocket,
            applied=solved.applied,
            surrounding=solved.resulting,
            bulk_modulus=getattr(self.fluid.fluid, "bulk_modulus", None) or np.inf,
            highest_pressure=self.highest_trapped,
            load=self.pressure,
            only_falls=solved.number > _RELEASE_ROUNDS,
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

    def solve_near_separation(self) -> CoupledContact:
        """Solve the contact at a nominal pressure at which the surfaces separate or nearly separate.

        The contact load is prescribed, and varied until the nominal pressure has the given value, see
        `find_contact_load`. Trapped liquid is ignored.
        """
        solution_by_load: dict[float, Any] = {}  # coupled contact for each contact load
        with_contact_load = replace(self.fluid, carrier="contact", trapped=False)

        def nominal_pressure(load: float) -> float:
            """Solve contact and flow for a contact load, or use the stored solution; return the nominal pressure."""
            if load not in solution_by_load:
                solution_by_load[load] = solve_coupled_contact(
                    with_contact_load,
                    self.gap0,
                    self.half_space,
                    pressure=load,
                    tolerance_factor=_SEARCH_TOLERANCE,
                    **self.settings,
                )
            return load + solution_by_load[load].carried

        load, minimum = find_contact_load(nominal_pressure, self.pressure, self.fluid.largest)
        if load is not None:
            return solution_by_load[load]
        # the surfaces separate: return the contact at first touch under the pressure of a linear potential
        applied = self.fluid.linear_drop(self.half_space.shape)
        contact = self._solve_contact(float(applied.mean()), applied)
        rounds = sum(solution.rounds for solution in solution_by_load.values())
        flow = Failed(self.fluid.separation_text(minimum))
        return CoupledContact(**vars(contact), flow=flow, carried=self.pressure, rounds=rounds)


@dataclass(frozen=True, eq=False)
class _Round:
    """Solutions of contact and flow in one round of the iteration.

    Attributes
    ----------
    number : int
        Number of the round, from 1.
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

    number: int
    applied: Array
    contact: Contact
    flow: FaceFlow | Failed
    resulting: Array
    trapped: TrappedLiquid | None = None
    closed_rounds: int = 0
    highest: float = 0.0

    def coupled_contact(self) -> CoupledContact:
        """Return contact and flow of this round as the result of the iteration."""
        return CoupledContact(
            **vars(self.contact),
            flow=self.flow,
            carried=float(self.applied.mean()),
            rounds=self.number,
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
