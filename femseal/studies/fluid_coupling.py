"""Contact of a face that its fluid presses apart: contact and flow give each other gap and fluid pressure.

The traction between the faces is t = p + p_f; the fluid keeps it from falling below p_f. The contact under p_f begins
from another gap, h₁ + K p_f, and carries p̄ − mean p_f (see `contact.solve_contact`); the flow through the gap it leaves
gives p_f. Both are solved in turn until the permeability stays. A face is open where no contact carries the rest of p̄.
p_f counts from the pressure of the surroundings, which
presses on the faces from outside too. In contact, and in pockets that no flow reaches, Δp_f = 0 between the pressures
around, as in a film of even permeability, however thin.
Several measured places of a face are in contact each by itself, and joined.
Source: Shvarts & Yastrebov, J. Mech. Phys. Solids 119, 2018, 140.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..base import Array, InputError, Shape, to_text
from ..contact import Contact, ContactLaw, HalfSpace, contact_law, solve_contact
from ..face.piece_flow import FaceFlow, Failed, FlowSettings, attempt, resolved_flow
from ..flow.cell import harmonic_fill
from ..flow.pressure_drop import pressure_between
from ..fluids import Fluid
from ..topography import Patches
from .trapped_liquid import TrappedLiquid, liquid_in_pockets

#: Relative change of the permeability at which the rounds end, and most of them. Measured on self-affine and turned
#: faces of 256² points, p̄/H .02 to .2: two to five for p_in/p̄ up to .3, at most six up to 1.
#: Pockets of liquid that lift the faces off each other's rims take up to twenty-five.
RTOL, MOST_ROUNDS = 1e-3, 60
#: Mean fluid pressure over the nominal pressure below which it changes leakage by less than 0.5 % and is left out.
LEAST_FRACTION = 1e-4
_POINTS = 201
#: Part of the nominal pressure that the fluid carries at most in the first round; part left to the contact where the
#: rounds end and the load is sought at which the faces part.
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

    flow : the flow; why there is none where the faces part or the rounds do not end, the gap being that of first touch
    or of the last round. carried : mean pressure that the fluid carries [Pa]. rounds : solutions of contact and flow.
    trapped : liquid in pockets that keeps its volume; None where it does not.
    """

    flow: FaceFlow | Failed
    carried: float
    rounds: int
    trapped: TrappedLiquid | None = None


@dataclass(frozen=True)
class FluidPressure:
    """A fluid between two pressures that presses the faces apart.

    inlet, outlet : its pressures [Pa]. nominal : "total", contact and fluid carry the nominal pressure together, or
    "contact". settings : how the flow is solved. surroundings : see `studies.Scene`.
    trapped : liquid in pockets keeps its volume.
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
        """Fluid pressure [Pa] above that of the surroundings where the viscous potential has fractions of its drop."""
        pressure = pressure_between(self.fluid, self.inlet, self.outlet, fraction)
        return np.asarray(pressure) - self._around

    @property
    def carried(self) -> float:
        """Mean pressure above the surroundings [Pa] where the potential falls evenly, as between parted faces."""
        return float(self.above_surroundings((np.arange(_POINTS) + 0.5) / _POINTS).mean())

    @property
    def mean(self) -> float:
        """Mean pressure [Pa] where the potential falls evenly."""
        return self.carried + self._around

    def relief(self, pressure: Any) -> Array:
        """By how much the contact pressure is below its mean over the seal, or the nominal one, under the fluid's [Pa].

        The piece lies there as it does dry under the pressure p̄ − p_f (Terzaghi's effective stress), from which that
        of its solution follows as the seal grows broad beside the long waves of the face.
        """
        return (
            np.asarray(pressure, dtype=float)
            - self._around
            - (0.0 if self.nominal == "total" else self.carried)
        )

    def parts(self, pressure: float) -> bool:
        """Whether the fluid between parted faces carries all of a nominal pressure [Pa]."""
        return self.nominal == "total" and self.carried >= pressure

    @staticmethod
    def parted(carried: float) -> str:
        """Why there is no leakage where the faces part, from the mean pressure that the fluid carries [Pa]."""
        return f"open: the faces part below {to_text(carried, 'Pa', 3)}, all of which the fluid carries"

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
        """Solve contact and flow in turn at a nominal pressure [Pa] until the permeability stays.

        The contact alone where the fluid carries less than 1e-4 of the load and none is trapped.

        former : liquid in the pockets of the load before. share : of the tolerance. settings : other arguments of
        `solve_contact`.

        Raises NotConverged: a contact failed.
        """
        if abs(self.carried) <= LEAST_FRACTION * pressure and not self.trapped:
            return solve_contact(gap0, half_space, pressure=pressure, **settings)
        together = self.nominal == "total"
        p_f = self.even_drop(half_space.shape)
        law = contact_law(settings.get("hardness", np.inf))
        most = _MOST_OF_HARDNESS * float(np.min(law.yield_pressure()))
        if former is not None:  # a load moves pockets as if they carried all of it
            p_f = np.minimum(former.on(p_f, pressure - former.load), most)
        trapped, last, error, closed, part = None, np.nan, np.inf, 0, 1.0
        scale, given, gave = max(abs(self.inlet), abs(self.outlet)), p_f, p_f
        for n in range(1, MOST_ROUNDS + 1):
            carried = float(p_f.mean())
            if n == 1 and together and carried > _FIRST_CARRIED * pressure:
                p_f = given = gave = p_f * (_FIRST_CARRIED * pressure / carried)
                carried = float(p_f.mean())
            room = pressure - carried if together else np.inf
            load = pressure if together else max(pressure + carried, 0.0)
            contact = solve_contact(gap0, half_space, pressure=load, fluid_pressure=p_f, **settings)
            flow = attempt(resolved_flow, contact.gap, half_space.spacing, self.settings)
            if isinstance(flow, Failed):
                break
            found, is_open = self._pressure(flow, p_f), contact.gap > 0
            if self.trapped:
                trapped = liquid_in_pockets(
                    former,
                    half_space,
                    contact.gap,
                    np.isnan(flow.potential) & is_open,
                    given=p_f,
                    around=found,
                    bulk_modulus=getattr(self.fluid, "bulk_modulus", None) or np.inf,
                    most=most,
                    load=pressure,
                    leaves=n > _RELEASE_ROUNDS,
                )
                in_contact = np.nan if is_open.any() else found
                found = harmonic_fill(np.where(is_open, trapped.on(found), in_contact))
                scale = max(scale, float(np.abs(found).max()))
            p_f, given, gave = _mixed(p_f, found, given, gave), p_f, found
            if trapped is not None:
                p_f = trapped.on(p_f)
            taken, part = part, 1.0
            if (more := float(p_f.mean()) - carried) >= room:
                part = 0.5 * room / more  # half of the way to where the contact carries nothing
                p_f = given + part * (p_f - given)
            k = flow.permeability
            if last:
                error = abs(k / last - 1) / taken
            else:  # closed faces have to stay as they are
                moved = float(np.abs((found - given).mean(axis=1)).max()) / scale
                error = moved if k == 0 else np.inf
            if trapped is not None:  # of closed faces only the volumes have to stay
                closed = closed + 1 if k == 0 else 0
                error = max(error if closed < _CLOSED_ROUNDS else 0.0, trapped.error)
            if error <= share * RTOL:
                return CoupledContact(
                    **vars(contact), flow=flow, carried=carried, rounds=n, trapped=trapped
                )
            if room <= _LEAST_ROOM * pressure:
                return self._near_opening(gap0, half_space, pressure, settings)
            last = k
        if not isinstance(flow, Failed):
            flow = Failed(
                f"contact and fluid pressure: after {n} rounds the permeability still changes by {error:.1e}"
            )
        return CoupledContact(**vars(contact), flow=flow, carried=carried, rounds=n)

    def _near_opening(
        self, gap0: Array, half_space: HalfSpace, pressure: float, settings: Mapping[str, Any]
    ) -> CoupledContact:
        """The contact at a nominal pressure [Pa] near to that at which the faces part, or below it.

        A load that the contact carries has a solution whatever the fluid carries besides, and both together are the
        nominal pressure. The faces part at the least of these. Above it the higher of two loads of the contact is
        taken, which a face has that is unloaded, or let under pressure, from where it is closed. No pockets are left.
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
        flow = Failed(self.parted(opening))
        return CoupledContact(**vars(contact), flow=flow, carried=pressure, rounds=rounds)

    def _pressure(self, flow: FaceFlow, former: Array) -> Array:
        """Pressure above the surroundings (n1, n2) [Pa] of a flow, also in contact; the former one if no gap is wet."""
        found = harmonic_fill(self.above_surroundings(flow.potential))
        return found if np.isfinite(found).all() else former

    def even_drop(self, shape: Shape) -> Array:
        """Pressure above the surroundings (n1, n2) [Pa] where the potential falls evenly along x1."""
        n1, n2 = shape
        return np.repeat(
            self.above_surroundings(1 - (np.arange(n1) + 0.5) / n1)[:, None], n2, axis=1
        )


def _mixed(given: Array, gave: Array, former: Array, former_gave: Array) -> Array:
    """The next fluid pressure, from the last two and what they gave: Anderson's mixing of depth one, over rows.

    Where every round overshoots the other way, as near closing, it takes part of both.
    """
    now, before = ((b - a).mean(axis=1) for a, b in ((given, gave), (former, former_gave)))
    change = now - before
    size = float(change @ change)
    if size == 0 or not before.any():
        return gave
    weight = float(np.clip(now @ change / size, 0.0, 0.5))
    return (1 - weight) * gave + weight * former_gave


def contact_of_places(
    gap0: Array,
    half_space: HalfSpace,
    *,
    places: Patches,
    solve: Callable[..., Contact],
    flow: FlowSettings,
    hardness: ContactLaw,
    deformation: Array | None = None,
    **settings: Any,
) -> Contact:
    """Solve the contact of each place under the same pressure, and join them; other arguments are those of `solve`.

    A fluid that presses the places apart flows through the gap of all of them at last.

    Raises InputError: a law that differs from place to place. NotConverged : a contact failed.
    """
    if not hardness.is_uniform:
        raise InputError(
            "hardness",
            "a law that differs from place to place",
            "the same everywhere in several places",
        )
    former = [None] * len(places.widths) if deformation is None else places.divided(deformation)
    found = []
    for gap, left in zip(places.divided(gap0), former, strict=True):
        body = replace(half_space, shape=gap.shape)
        # gaps are counted from the highest point of the place
        from_highest = np.ascontiguousarray(gap - gap.min())
        found.append(solve(from_highest, body, hardness=hardness, deformation=left, **settings))
    arrays = ("pressure", "gap", "plastic_deformation", "plastic")
    joined: dict[str, Any] = {
        name: np.concatenate([getattr(c, name) for c in found], axis=1) for name in arrays
    }
    joined |= {
        "approach": float(np.average([c.approach for c in found], weights=places.widths)),
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
        carried=float(np.average(carried, weights=places.widths)),
        rounds=max(c.rounds for c in coupled),
    )
