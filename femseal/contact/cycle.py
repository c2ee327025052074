"""Loading and unloading with plastic memory.

First loading is path independent. Unloading from p_u adds the permanent deformation u_p to the gap once and solves with
the same bounds, so that it returns the state at p_u, coincides with reloading, and meets the virgin curve beyond p_u.
Source: Sahlin et al., Proc. IMechE J 224, 2010, 335; Pérez-Ràfols et al., 2018.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from math import inf
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..base import validate
from ..base.errors import InputError
from ..base.quantities import to_text
from ..base.text import Plotted, fact_table
from ..runs.executor import HeavyTask
from .half_space import HalfSpace
from .solver import Contact, hardness_bounds, solve_contact

#: Fields over all points that the contact of a state takes, with gap, memory and result.
STATE_FIELDS = 20


@dataclass(frozen=True)
class LoadStep:
    """One step of a load programme: nominal pressure [Pa] on loading, or on unloading from a peak."""

    pressure: float
    unloaded_from: float | None = None

    @property
    def branch(self) -> str:
        """ "loading" or "unloading"."""
        return "loading" if self.unloaded_from is None else "unloading"

    @property
    def name(self) -> str:
        """Readable name, such as "unloading 200 MPa from 900 MPa"."""
        end = "" if self.unloaded_from is None else f" from {self.unloaded_from / 1e6:g} MPa"
        return f"{self.branch} {self.pressure / 1e6:g} MPa{end}"


@dataclass(frozen=True, repr=False)
class LoadState(LoadStep, Plotted):
    """A step of a load programme and the contact there.

    yielded_again : share of points that unloading deformed further for good; the material flows on where the load
        moves to points that were not plastic at the peak.
    """

    contact: Contact = field(kw_only=True)
    yielded_again: float = field(default=0.0, kw_only=True, metadata={"unit": "1"})

    def __repr__(self) -> str:
        return f"LoadState({self.name}, {self.contact!r}, yielded_again {self.yielded_again:.3g})"

    def _repr_html_(self) -> str:
        return f"<p>{self.name}</p>\n{self.contact._repr_html_()}"


class LoadCycle(tuple[LoadState, ...], Plotted):
    """The states of a load cycle, a tuple that shows itself."""

    __slots__ = ()

    def __repr__(self) -> str:
        return f"LoadCycle({', '.join(f'{s.name}: contact {s.contact.area_fraction:.1%}' for s in self)})"

    def _repr_html_(self) -> str:
        head = ("step", "in contact", "at hardness", "mean gap", "residual")
        lines = []
        for state in self:
            c = state.contact
            shares = (f"{share:.1%}" for share in (c.area_fraction, c.plastic_fraction))
            lines.append((state.name, *shares, to_text(c.mean_gap, "m"), f"{c.residual:.1e}"))
        return fact_table("load cycle", lines, head)


def load_programme(
    loading: Sequence[float], unload_from: Sequence[float] = (), unloading: Sequence[float] = ()
) -> tuple[LoadStep, ...]:
    """Steps of a cycle: the loading curve, with every peak on it, then each unloading in falling order.

    Parameters
    ----------
    loading : rising nominal pressures >= 0 [Pa].
    unload_from : pressures from which the seal is unloaded [Pa]; those not in `loading` are added to it.
    unloading : nominal pressures to stop at on the way down [Pa]; each peak uses those below it.

    Raises
    ------
    InputError : an empty or falling list, negative or non-finite pressures, a peak with nothing below it.
    """
    loading, unload_from, unloading = (
        _pressures(name, values)
        for name, values in (("loading", loading), ("unload_from", unload_from), ("unloading", unloading))
    )
    if len(loading) == 0:
        raise InputError.of("loading", "an empty list", "at least one pressure [Pa]")
    if any(b <= a for a, b in pairwise(loading)):
        raise InputError.of("loading", loading, "rising pressures")
    if len(unloading) and not len(unload_from):
        raise InputError.of("unload_from", "an empty list", "at least one pressure where `unloading` is given")
    steps = [LoadStep(p) for p in sorted({*loading, *unload_from})]
    for peak in sorted(set(unload_from)):
        below = sorted({p for p in unloading if p < peak}, reverse=True)
        if not below:
            raise InputError.of("unloading", unloading, f"at least one pressure below the peak {peak:g} Pa")
        steps += [LoadStep(p, peak) for p in below]
    return tuple(steps)


def peak_indices(steps: Sequence[LoadStep]) -> np.ndarray:
    """Number of the loading step from which each step is unloaded; on loading its own."""
    loading = {s.pressure: n for n, s in enumerate(steps) if s.unloaded_from is None}
    return np.array([n if s.unloaded_from is None else loading[s.unloaded_from] for n, s in enumerate(steps)])


def _pressures(name: str, values: Sequence[float]) -> list[float]:
    try:
        return [validate.number(name, p, unit="Pa", inclusive=True) for p in values]
    except (TypeError, InputError):
        given = values if isinstance(values, str) or not np.iterable(values) else list(values)
        raise InputError.of(name, given, "a list of finite pressures >= 0 [Pa]") from None


def load_cycle(
    gap0: ArrayLike,
    half_space: HalfSpace,
    *,
    loading: Sequence[float],
    hardness: float | ArrayLike = inf,
    unload_from: Sequence[float] = (),
    unloading: Sequence[float] = (),
    rtol: float = 1e-6,
) -> LoadCycle:
    """Contact along a loading curve and along any number of unloadings that share it; `load_states` one by one.

    Parameters
    ----------
    gap0 : undeformed gap (n1, n2) [m].
    half_space : elastic body and grid.
    loading, unload_from, unloading : nominal pressures [Pa], see `load_programme`.
    hardness : H [Pa], a number or one per point.
    rtol : residual of each solution, see `solve_contact`.

    Returns
    -------
    The states in the order of `load_programme`. On unloading, `plastic_deformation` is the permanent deformation
    left by the peak, plus what a further yielding added.

    Raises
    ------
    InputError, NotConverged : as `solve_contact`; the whole programme is checked before anything is solved.
    """
    return LoadCycle(
        load_states(
            gap0,
            half_space,
            loading=loading,
            hardness=hardness,
            unload_from=unload_from,
            unloading=unloading,
            rtol=rtol,
        )
    )


def load_states(
    gap0: ArrayLike,
    half_space: HalfSpace,
    *,
    loading: Sequence[float],
    hardness: float | ArrayLike = inf,
    unload_from: Sequence[float] = (),
    unloading: Sequence[float] = (),
    rtol: float = 1e-6,
    take: Callable[[LoadState], Any] | None = None,
    memory: float | None = None,
    map: Callable[..., Iterable[Any]] = map,
) -> Iterator[Any]:
    """The states of `load_cycle` one after another, checked at once and solved when asked for, none of them kept.

    Parameters
    ----------
    take : what to give of each state instead of the state itself, worked out where that is solved.
    memory : that a state takes with `take` [byte], unless given that of the contact; a map over processes solves no
        more at once than fit.
    map : how to solve states that do not depend on each other, in order: those of loading, then those of unloading.
    """
    steps = load_programme(loading, unload_from, unloading)
    highest = max(s.pressure for s in steps)
    if highest > (limit := float(hardness_bounds(hardness, half_space.shape).mean())) * (1 + 1e-12):
        raise InputError.of("loading", f"{highest:g} Pa", f"at most the mean hardness, {limit:g} Pa")
    gap0 = validate.field("gap0", gap0, unit="m", shape=half_space.shape, copy=False)
    task = HeavyTask(_state, gap0=gap0, half_space=half_space, hardness=hardness, rtol=rtol, take=take)
    task.memory = 8.0 * STATE_FIELDS * gap0.size if memory is None else memory
    return _solved(task, steps, map)


def _solved(task: Callable[..., Any], steps: Sequence[LoadStep], map: Callable[..., Iterable[Any]]) -> Iterator[Any]:
    peaks = {step.unloaded_from for step in steps}
    loading = [step for step in steps if step.unloaded_from is None]
    unloading = steps[len(loading) :]
    left: dict[float | None, np.ndarray] = {}
    for step, (taken, deformation) in zip(
        loading, map(task, loading, [step.pressure in peaks for step in loading]), strict=True
    ):
        if deformation is not None:
            left[step.pressure] = deformation
        yield taken
    for taken, _ in map(task, unloading, [False] * len(unloading), (left[step.unloaded_from] for step in unloading)):
        yield taken


def _state(
    step: LoadStep,
    peak: bool,
    memory: np.ndarray | None = None,
    *,
    gap0: np.ndarray,
    half_space: HalfSpace,
    hardness: float | ArrayLike,
    rtol: float,
    take: Callable[[LoadState], Any] | None,
) -> tuple[Any, np.ndarray | None]:
    """What is taken of a state, and the permanent deformation that a peak leaves."""
    contact = solve_with_memory(gap0, half_space, memory, pressure=step.pressure, hardness=hardness, rtol=rtol)
    again = 0.0 if memory is None else _yielded_again(contact, memory, rtol)
    state = LoadState(step.pressure, step.unloaded_from, contact=contact, yielded_again=again)
    return state if take is None else take(state), contact.plastic_deformation if peak else None


def _yielded_again(contact: Contact, memory: np.ndarray, rtol: float) -> float:
    """Share of points whose permanent deformation grew, beyond what the residual leaves open."""
    # the displacement of a pixel under the hardness is about pressure / stiffness
    spacing = contact.half_space.spacing
    depth = 4 * max(spacing) * float(contact.pressure.max()) / (np.pi * contact.half_space.modulus)
    grown = contact.plastic_deformation - memory > 100 * rtol * depth
    return float(np.count_nonzero(grown) / grown.size)


def solve_with_memory(
    gap0: np.ndarray,
    half_space: HalfSpace,
    memory: np.ndarray | None,
    *,
    pressure: float,
    hardness: float | ArrayLike,
    rtol: float,
) -> Contact:
    """`solve_contact` on a gap to which a permanent deformation is added first; it stays part of the result's."""
    if memory is None:
        return solve_contact(gap0, half_space, pressure=pressure, hardness=hardness, rtol=rtol)
    contact = solve_contact(gap0 + memory, half_space, pressure=pressure, hardness=hardness, rtol=rtol)
    return replace(contact, plastic_deformation=contact.plastic_deformation + memory)
