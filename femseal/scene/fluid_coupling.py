"""Contact under a fluid pressure that acts on the surfaces: the contact gives the gap, and the flow gives the pressure.

The traction between the surfaces is t = p + p_f, with the contact pressure p and the fluid pressure p_f, below which it
cannot fall. The contact under p_f starts from the gap h₁ + K p_f, and carries p̄ − mean p_f of the nominal pressure p̄
(see `contact.solve_contact`). The flow through the gap that remains gives p_f. Both are solved in turn until the
permeability no longer changes. A seal is open where no contact can carry the rest of p̄.

p_f is counted from the pressure of the surroundings, which acts on the outside of the bodies too. In contact, and in
pockets that no flow reaches, it obeys Δp_f = 0 between the pressures around, as in a film of uniform permeability.

Several measured patches are in contact each by itself, and the flow passes through all of them.

Source: Shvarts & Yastrebov, J. Mech. Phys. Solids 119, 2018, 140.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..base import Array, InputError, Shape, to_text
from ..contact import Contact, ContactLaw, HalfSpace, contact_law, solve_contact
from ..face.cell_flow import FaceFlow, Failed, FlowSettings, attempt, resolved_flow
from ..flow.cell import harmonic_fill
from ..flow.pressure_drop import pressure_between
from ..fluids import Fluid
from ..topography import Patches
from .trapped_liquid import TrappedLiquid, liquid_in_pockets

#: Relative change of the permeability at which the rounds end, and their largest number. Measured on self-affine and
#: turned surfaces of 256² points with p̄/H from 0.02 to 0.2: two to five rounds for p_in/p̄ up to 0.3, and at most six up
#: to 1. Pockets whose liquid lifts their rims take up to 25.
RTOL, MOST_ROUNDS = 1e-3, 60
#: Mean fluid pressure over the nominal pressure below which it changes leakage by less than 0.5 % and is left out.
LEAST_FRACTION = 1e-4
_POINTS = 201
#: Part of the nominal pressure that the fluid carries at most in the first round; and part left to the contact at which
#: the rounds end, and the load is sought at which the surfaces separate.
_FIRST_CARRIED, _LEAST_ROOM = 0.9, 0.01
#: Loads of the contact over the pressure of the inlet among which the least nominal pressure is sought; the factor from
#: one load to the next above them; relative error of a load; share of the tolerance of the rounds under it.
_LOADS, _STEP, _LOAD_RTOL, _SHARE = np.array([1e-4, 1e-2, 1e-1]), 3.0, 1e-4, 0.1
#: Rounds after which a face that holds trapped liquid counts as closed, and after which its liquid only leaves.
_CLOSED_ROUNDS, _RELEASE_ROUNDS = 4, 25
#: The metal around a pocket flows under a liquid at its hardness. What would need more than this fraction escapes.
_MOST_OF_HARDNESS = 0.9


@dataclass(frozen=True, kw_only=True)
class CoupledContact(Contact):
    """A contact under a fluid pressure that the flow through its gap gives.

    Attributes
    ----------
    flow : through the gap; or the reason why there is none, where the surfaces separate (the gap is then that of first
        touch) or the rounds do not converge (that of the last round).
    carried : mean pressure that the fluid carries [Pa].
    rounds : number of solutions of contact and flow.
    trapped : liquid in pockets that keeps its volume; None where it does not.
    """

    flow: FaceFlow | Failed
    carried: float
    rounds: int
    trapped: TrappedLiquid | None = None


@dataclass(frozen=True)
class FluidPressure:
    """A fluid between two pressures that act on the surfaces.

    Attributes
    ----------
    fluid : with its viscosity and density.
    inlet, outlet : its pressures [Pa].
    nominal : what carries the nominal pressure: "total", contact and fluid together; or "contact", the contact alone.
    settings : how the flow is solved.
    surroundings : pressure around the seal [Pa], see `Scene`.
    trapped : whether liquid in closed pockets keeps its volume.
    """

    fluid: Fluid
    inlet: float
    outlet: float
    nominal: str
    settings: FlowSettings
    surroundings: float | None = None
    trapped: bool = False

    @property
    def _around(self) -> float:
        """Pressure of the surroundings [Pa], on the scale of the fluid's."""
        return (
            float(getattr(self.fluid, "outlet_pressure", 0.0))
            if self.surroundings is None
            else self.surroundings
        )

    def above_surroundings(self, fraction: Any) -> Array:
        """Compute the fluid pressure above that of the surroundings [Pa] at fractions of the drop of the potential."""
        pressure = pressure_between(self.fluid, self.inlet, self.outlet, fraction)
        return np.asarray(pressure) - self._around

    @property
    def carried(self) -> float:
        """Mean pressure above the surroundings if the potential falls linearly, as between separated surfaces [Pa]."""
        return float(self.above_surroundings((np.arange(_POINTS) + 0.5) / _POINTS).mean())

    @property
    def mean(self) -> float:
        """Mean pressure if the potential falls linearly [Pa]."""
        return self.carried + self._around

    def relief(self, pressure: Any) -> Array:
        """Compute by how much a fluid pressure reduces the contact pressure of a cell below the nominal one [Pa].

        A cell is in contact as without a fluid under the pressure p̄ − p_f, Terzaghi's effective stress. The coupled
        solution tends to this as the seal becomes broad in comparison with the long waves of the surface.

        pressure : of the fluid in the cell [Pa].
        """
        return (
            np.asarray(pressure, dtype=float)
            - self._around
            - (0.0 if self.nominal == "total" else self.carried)
        )

    def separates(self, pressure: float) -> bool:
        """Tell whether the fluid between separated surfaces carries the whole nominal pressure [Pa]."""
        return self.nominal == "total" and self.carried >= pressure

    @staticmethod
    def separation_text(carried: float) -> str:
        """Say why separated surfaces have no leakage, from the mean pressure that the fluid carries [Pa]."""
        limit = to_text(carried, "Pa", 3)
        return f"open: the surfaces separate below {limit}, all of which the fluid carries"

    def contact(
        self,
        gap0: Array,
        half_space: HalfSpace,
        *,
        pressure: float,
        former: TrappedLiquid | None = None,
        share: float = 1.0,
        **settings: Any,
    ) -> Contact | CoupledContact:
        """Solve contact and flow in turn until the permeability no longer changes.

        Where the fluid carries less than 1e-4 of the load and none is trapped, the contact is solved alone.

        Parameters
        ----------
        gap0 : gap of first touch, array (n1, n2) [m].
        half_space : elastic body.
        pressure : nominal pressure [Pa].
        former : liquid in the pockets of the load before; None at the first load.
        share : factor on the tolerance.
        settings : other arguments of `solve_contact`.

        Raises
        ------
        NotConverged : a contact failed.
        """
        if abs(self.carried) <= LEAST_FRACTION * pressure and not self.trapped:
            return solve_contact(gap0, half_space, pressure=pressure, **settings)
        law = contact_law(settings.get("hardness", np.inf))
        most_trapped = _MOST_OF_HARDNESS * float(np.min(law.yield_pressure()))
        applied = self._first_pressure(half_space.shape, pressure, former, most_trapped)
        previous: _Round | None = None
        step = change = 1.0
        for number in range(1, MOST_ROUNDS + 1):
            solved = self._round(gap0, half_space, pressure, applied, settings)
            if isinstance(solved.flow, Failed):
                return solved.coupled_contact(number)
            if self.trapped:
                leaves = number > _RELEASE_ROUNDS
                solved = self._with_trapped_liquid(
                    solved, previous, former, pressure, most=most_trapped, leaves=leaves
                )
            change = solved.change(previous, step, max(abs(self.inlet), abs(self.outlet)))
            if change <= share * RTOL:
                return solved.coupled_contact(number)
            left_to_contact = self._left_to_contact(pressure, applied)
            if left_to_contact <= _LEAST_ROOM * pressure:
                return self._near_opening(gap0, half_space, pressure, settings)
            applied, step = _next_pressure(solved, previous, left_to_contact)
            previous = solved
        reason = f"contact and fluid pressure: after {number} rounds the permeability still changes by {change:.1e}"
        return replace(solved, flow=Failed(reason), trapped=None).coupled_contact(number)

    def _first_pressure(
        self, shape: Shape, pressure: float, former: TrappedLiquid | None, most_trapped: float
    ) -> Array:
        """Choose the fluid pressure (n1, n2) [Pa] of the first round: that of a potential that falls linearly.

        Where it would carry nearly the whole nominal pressure [Pa], it is reduced, and the contact carries the rest.

        former : liquid in the pockets of the load before. most_trapped : most pressure of trapped liquid [Pa].
        """
        applied = self.even_drop(shape)
        if former is not None:  # a load moves pockets as if they carried all of it
            applied = np.minimum(former.on(applied, pressure - former.load), most_trapped)
        carried = float(applied.mean())
        if self.nominal == "total" and carried > _FIRST_CARRIED * pressure:
            applied = applied * (_FIRST_CARRIED * pressure / carried)
        return applied

    def _left_to_contact(self, pressure: float, applied: Array) -> float:
        """Compute what a fluid pressure leaves of the nominal pressure to the contact [Pa]; inf if both add up."""
        return pressure - float(applied.mean()) if self.nominal == "total" else np.inf

    def _round(
        self,
        gap0: Array,
        half_space: HalfSpace,
        pressure: float,
        applied: Array,
        settings: Mapping[str, Any],
    ) -> _Round:
        """Solve the contact under a fluid pressure (n1, n2) [Pa], and the flow through the gap that it leaves."""
        load = pressure
        if self.nominal == "contact":
            load = max(pressure + float(applied.mean()), 0.0)
        contact = solve_contact(gap0, half_space, pressure=load, fluid_pressure=applied, **settings)
        flow = attempt(resolved_flow, contact.gap, half_space.spacing, self.settings)
        resulting = applied if isinstance(flow, Failed) else self._pressure(flow, applied)
        return _Round(applied, contact, flow, resulting)

    def _with_trapped_liquid(
        self,
        solved: _Round,
        previous: _Round | None,
        former: TrappedLiquid | None,
        pressure: float,
        *,
        most: float,
        leaves: bool,
    ) -> _Round:
        """Add the pressure of the liquid in pockets that no flow reaches to the result of a round.

        former : liquid in the pockets of the load before. most : most pressure of trapped liquid [Pa]. leaves : liquid
        only leaves pockets, so that the rounds end.
        """
        assert isinstance(solved.flow, FaceFlow)
        is_open = solved.contact.gap > 0
        trapped = liquid_in_pockets(
            former,
            solved.contact.half_space,
            solved.contact.gap,
            np.isnan(solved.flow.potential) & is_open,
            given=solved.applied,
            around=solved.resulting,
            bulk_modulus=getattr(self.fluid, "bulk_modulus", None) or np.inf,
            most=most,
            load=pressure,
            leaves=leaves,
        )
        in_contact = np.nan if is_open.any() else solved.resulting
        resulting = harmonic_fill(np.where(is_open, trapped.on(solved.resulting), in_contact))
        rounds_before = 0 if previous is None else previous.closed_rounds
        highest_before = 0.0 if previous is None else previous.highest
        return replace(
            solved,
            resulting=resulting,
            trapped=trapped,
            closed_rounds=rounds_before + 1 if solved.flow.permeability == 0 else 0,
            highest=max(highest_before, float(np.abs(resulting).max())),
        )

    def _near_opening(
        self, gap0: Array, half_space: HalfSpace, pressure: float, settings: Mapping[str, Any]
    ) -> CoupledContact:
        """Solve the contact at a nominal pressure [Pa] near that at which the surfaces separate, or below it.

        For every load of the contact there is a solution, and the load together with what the fluid carries is a
        nominal pressure. The surfaces separate at the least of these. Above it there are two loads of the contact. The
        higher one is taken, which belongs to a surface that is unloaded, or put under pressure, from a closed state.
        Liquid in pockets is left out.
        """
        from scipy.optimize import brentq, minimize_scalar

        known: dict[float, Any] = {}
        alone = replace(self, nominal="contact", trapped=False)

        def total(load: float) -> float:
            if load not in known:
                known[load] = alone.contact(
                    gap0, half_space, pressure=load, share=_SHARE, **settings
                )
            return load + known[load].carried

        loads = (_LOADS * max(abs(self.inlet), abs(self.outlet))).tolist()
        totals = [total(load) for load in loads]
        n = int(np.argmin(totals))
        least, opening = loads[n], totals[n]
        if n > 0:
            ends = np.log([loads[n - 1], loads[min(n + 1, len(loads) - 1)]])
            lowest = minimize_scalar(
                lambda x: total(float(np.exp(x))),
                bounds=ends,
                method="bounded",
                options={"xatol": 0.3},
            )
            least, opening = float(np.exp(lowest.x)), float(lowest.fun)
        if pressure > opening:
            above = least
            while total(above) < pressure:
                above *= _STEP
            return known[
                brentq(lambda load: total(load) - pressure, above / _STEP, above, rtol=_LOAD_RTOL)
            ]
        even = self.even_drop(half_space.shape)
        contact = solve_contact(
            gap0, half_space, pressure=float(even.mean()), fluid_pressure=even, **settings
        )
        rounds = sum(c.rounds for c in known.values())
        flow = Failed(self.separation_text(opening))
        return CoupledContact(**vars(contact), flow=flow, carried=pressure, rounds=rounds)

    def _pressure(self, flow: FaceFlow, former: Array) -> Array:
        """Compute the pressure of a flow above the surroundings, also in contact (n1, n2) [Pa].

        Where the flow reaches no gap it is the former pressure.
        """
        found = harmonic_fill(self.above_surroundings(flow.potential))
        return found if np.isfinite(found).all() else former

    def even_drop(self, shape: Shape) -> Array:
        """Compute the pressure above the surroundings (n1, n2) [Pa] of a potential that falls linearly along x1."""
        n1, n2 = shape
        return np.repeat(
            self.above_surroundings(1 - (np.arange(n1) + 0.5) / n1)[:, None], n2, axis=1
        )


@dataclass(frozen=True, eq=False)
class _Round:
    """A solution of the contact under a fluid pressure, and of the flow through its gap.

    applied : fluid pressure of the contact (n1, n2) [Pa]. resulting : that which the flow gives (n1, n2) [Pa].
    trapped : liquid in pockets, None where none keeps its volume. closed_rounds : rounds in a row, this one included,
    in which trapped liquid lies in a surface without flow. highest : highest pressure with trapped liquid so far [Pa].
    """

    applied: Array
    contact: Contact
    flow: FaceFlow | Failed
    resulting: Array
    trapped: TrappedLiquid | None = None
    closed_rounds: int = 0
    highest: float = 0.0

    def coupled_contact(self, rounds: int) -> CoupledContact:
        """Return the contact with its flow, after so many rounds."""
        return CoupledContact(
            **vars(self.contact),
            flow=self.flow,
            carried=float(self.applied.mean()),
            rounds=rounds,
            trapped=self.trapped,
        )

    def change(self, previous: _Round | None, step: float, scale: float) -> float:
        """Compute the relative change of the permeability since the previous round; inf in the first round.

        Of closed surfaces it is the change of the fluid pressure over the highest pressure. Of surfaces that stay
        closed over trapped liquid, it is that of the volumes of the liquid alone.

        step : part of the change of the fluid pressure that was taken. scale : pressure of the fluid's ends [Pa].
        """
        if previous is None:
            return np.inf
        assert isinstance(self.flow, FaceFlow)
        assert isinstance(previous.flow, FaceFlow)
        before, now = previous.flow.permeability, self.flow.permeability
        if before:
            change = abs(now / before - 1) / step
        elif now:
            change = np.inf
        else:
            moved = float(np.abs((self.resulting - self.applied).mean(axis=1)).max())
            change = moved / max(scale, self.highest)
        if self.trapped is None:
            return change
        if self.closed_rounds >= _CLOSED_ROUNDS:
            change = 0.0
        return max(change, self.trapped.error)


def _next_pressure(
    solved: _Round, previous: _Round | None, left_to_contact: float
) -> tuple[Array, float]:
    """Choose the fluid pressure (n1, n2) [Pa] of the next round, and the part of the change that it takes.

    left_to_contact : nominal pressure that the contact carried [Pa]. Where the fluid would carry all of it, half of the
    way to there is taken.
    """
    proposed = _mixed_pressure(solved, previous)
    if solved.trapped is not None:
        proposed = solved.trapped.on(proposed)
    more = float(proposed.mean()) - float(solved.applied.mean())
    if more < left_to_contact:
        return proposed, 1.0
    step = 0.5 * left_to_contact / more
    return solved.applied + step * (proposed - solved.applied), step


def _mixed_pressure(solved: _Round, previous: _Round | None) -> Array:
    """Mix the fluid pressures that the last two rounds gave: Anderson's mixing of depth one, over means of rows.

    Where every round overshoots the other way, as near closing, it takes part of both.
    """
    if previous is None:
        return solved.resulting
    residual = (solved.resulting - solved.applied).mean(axis=1)
    former_residual = (previous.resulting - previous.applied).mean(axis=1)
    difference = residual - former_residual
    squared = float(difference @ difference)
    if squared == 0 or not former_residual.any():
        return solved.resulting
    weight = float(np.clip(residual @ difference / squared, 0.0, 0.5))
    return (1 - weight) * solved.resulting + weight * previous.resulting


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
    """Solve the contact of each measured patch under the same pressure, and join their fields.

    Where a fluid pressure acts on the patches, the flow through the gap of all of them is solved at last.

    Parameters
    ----------
    gap0, half_space, hardness, deformation, settings : arguments of `solve`, for all patches side by side.
    patches : the surface.
    solve : solves the contact of one patch.
    flow : how the flow through all patches is solved.

    Raises
    ------
    InputError : the contact law differs from patch to patch.
    NotConverged : a contact failed.
    """
    if not hardness.is_uniform:
        given = "a law that differs from patch to patch"
        raise InputError("hardness", given, "the same everywhere in several patches")
    former: Iterable[Array | None]
    if deformation is None:
        former = [None] * len(patches.widths)
    else:
        former = patches.divided(deformation)
    found = []
    for gap, left in zip(patches.divided(gap0), former, strict=True):
        body = replace(half_space, shape=gap.shape)
        # gaps are counted from the highest point of the patch
        from_highest = np.ascontiguousarray(gap - gap.min())
        found.append(solve(from_highest, body, hardness=hardness, deformation=left, **settings))
    arrays = ("pressure", "gap", "plastic_deformation", "plastic")
    joined: dict[str, Any] = {
        name: np.concatenate([getattr(c, name) for c in found], axis=1) for name in arrays
    }
    joined |= {
        "approach": float(np.average([c.approach for c in found], weights=patches.widths)),
        "residual": max(c.residual for c in found),
        "iterations": max(c.iterations for c in found),
        "fft_pairs": sum(c.fft_pairs for c in found),
        "half_space": half_space,
    }
    coupled = [c for c in found if isinstance(c, CoupledContact)]
    if not coupled:
        return Contact(**joined)
    failed = [c.flow for c in coupled if isinstance(c.flow, Failed)]
    carried = [getattr(c, "carried", 0.0) for c in found]
    return CoupledContact(
        **joined,
        flow=(*failed, attempt(resolved_flow, joined["gap"], half_space.spacing, flow))[0],
        carried=float(np.average(carried, weights=patches.widths)),
        rounds=max(c.rounds for c in coupled),
    )
