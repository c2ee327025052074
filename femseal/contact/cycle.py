"""Contact along a load programme, with the plastic deformation that every peak leaves behind.

First loading is path independent. On unloading from a peak p_u, the plastic deformation u_p of the peak is added to the
gap once, and the contact is solved with the law that the points have after it, the same one or a harder one. At p_u
this returns the state of the peak; reloading follows the unloading curve, and beyond p_u it follows the first loading.
Source: Sahlin et al., Proc. IMechE J 224, 2010, 335; Pérez-Ràfols et al., 2018.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from math import inf
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..base import Mapper, Plotted, Stage, TextTable, to_text, validate
from ..loads import LoadProgramme, LoadStep
from .half_space import HalfSpace
from .law import ContactLaw, contact_law
from .solver import Contact, check_capacity, solve_contact

#: Number of fields over all points that solving a state needs, with gap, plastic deformation and result.
STATE_FIELDS = 20


@dataclass(frozen=True, eq=False)
class _Solved:
    """A solved load step.

    taken : value of `take`, or the state itself.
    deformation : plastic deformation (n1, n2) [m] that a peak leaves to its unloading; None of other steps.
    remembered : value of `remember`.
    has_yielded : whether any point has deformed for good.
    """

    taken: Any
    deformation: np.ndarray | None = None
    remembered: Any = None
    has_yielded: bool = False


_NOTHING_BEFORE = _Solved(taken=None)


@dataclass(frozen=True, repr=False)
class LoadState(LoadStep, Plotted):
    """A step of a load programme and the contact there.

    yielded_again : fraction of points that yield on unloading. This happens where the load moves to points that were
    not
        plastic at the peak.
    """

    contact: Contact = field(kw_only=True)
    yielded_again: float = field(default=0.0, kw_only=True, metadata={"unit": "1"})

    def __repr__(self) -> str:
        return f"LoadState({self.name}, {self.contact!r}, yielded_again {self.yielded_again:.3g})"

    def _repr_html_(self) -> str:
        return f"<p>{self.name}</p>\n{self.contact._repr_html_()}"


class LoadCycle(tuple[LoadState, ...], Plotted):
    """The states of a load cycle: a tuple with a table and a picture."""

    __slots__ = ()

    def __repr__(self) -> str:
        return f"LoadCycle({', '.join(f'{s.name}: contact {s.contact.area_fraction:.1%}' for s in self)})"

    def _repr_html_(self) -> str:
        head = ("step", "in contact", "at hardness", "mean gap", "residual")
        lines = []
        for state in self:
            c = state.contact
            fractions = (f"{part:.1%}" for part in (c.area_fraction, c.plastic_fraction))
            lines.append((state.name, *fractions, to_text(c.mean_gap, "m"), f"{c.residual:.1e}"))
        return TextTable("load cycle", head, tuple(lines))._repr_html_()


def load_cycle(
    gap0: ArrayLike,
    half_space: HalfSpace,
    *,
    loading: Sequence[float],
    hardness: float | ArrayLike | ContactLaw = inf,
    unload_from: Sequence[float] = (),
    unloading: Sequence[float] = (),
    rtol: float = 1e-6,
) -> LoadCycle:
    """Solve the contact along a loading curve and along any number of unloadings from it.

    Parameters
    ----------
    gap0 : undeformed gap (n1, n2) [m].
    half_space : elastic body and grid.
    loading, unload_from, unloading : nominal pressures [Pa], see `LoadProgramme.of`.
    hardness : H [Pa], a number or one per point, or a law; see `solve_contact`.
    rtol : residual of each solution, see `solve_contact`.

    Returns
    -------
    The states in the order of the programme. On unloading, `plastic_deformation` is that of the peak plus what yields
    afterwards.

    Raises
    ------
    InputError, NotConverged : as `solve_contact`; the whole programme is checked before anything is solved.

    Examples
    --------
    >>> import femseal as fs
    >>> face = fs.self_affine((32, 32), (32e-6, 32e-6), hurst=0.8, rms_slope=0.2, roll_off=20e-6, rng=1)
    >>> body = fs.HalfSpace(face.shape, face.spacing, modulus=115e9)
    >>> pressures = {"loading": [1e8, 3e8], "unload_from": [3e8], "unloading": [1e8]}
    >>> for state in load_cycle(face.gap(), body, hardness=3e9, **pressures):
    ...     print(state.name, "mean gap", f"{1e6 * state.contact.mean_gap:.2f} µm")
    loading 100 MPa mean gap 0.79 µm
    loading 300 MPa mean gap 0.60 µm
    unloading 100 MPa from 300 MPa mean gap 0.65 µm
    """
    programme = LoadProgramme.of(loading, unload_from, unloading)
    solve = contact_at_loads(gap0, half_space, programme, contact_law(hardness))
    return LoadCycle(load_states(programme, solve, rtol=rtol))


def contact_at_loads(
    gap0: ArrayLike,
    half_space: HalfSpace,
    programme: LoadProgramme,
    law: ContactLaw,
    solve: Callable[..., Contact] = solve_contact,
) -> Callable[..., Contact]:
    """The contact of this gap by this law at a load, `pressure` being left to give, once the programme is checked.

    solve : called as `solve_contact`, such as one with a fluid between the faces.
    """
    law.tangent(half_space.shape)  # checks its shape
    check_capacity("loading", float(programme.pressures.max()), law)
    gap0 = validate.field("gap0", gap0, unit="m", shape=half_space.shape, copy=False)
    return partial(solve, gap0, half_space, hardness=law)


def load_states(
    programme: LoadProgramme,
    solve: Callable[..., Contact],
    *,
    rtol: float = 1e-6,
    take: Callable[[LoadState], Any] | None = None,
    remember: Callable[[Contact], Any] | None = None,
    memory: float = 0.0,
    mapper: Mapper = map,
) -> Iterator[Any]:
    """Solve the contact states of a programme one after another.

    Where no point has yielded, unloading goes back along the loading: a pressure that has been solved is then not
    solved again, and what was taken of its state is returned once more. No other state is kept.

    Parameters
    ----------
    programme : the load steps. solve : the contact at a load, see `contact_at_loads`. rtol : as in `load_cycle`.
    take : function of the contact of a state, called in the process that solves it; its value is returned in place of
        the state.
    remember : what a contact leaves to the next load besides its plastic deformation, which `solve` takes as `former`:
        loads are then solved one after another.
    memory : of solving a state and of `take` together [byte]; a mapper over processes solves no more states at once
        than fit.
    mapper : solves the states of a branch, which do not depend on each other: first loading, then unloading.
    """
    state = partial(_state, solve=solve, rtol=rtol, take=take, remember=remember)
    stage = Stage("contact of the whole face", state, memory)
    return _solved(stage, programme, remember is not None, mapper)


def _solved(stage: Stage, programme: LoadProgramme, in_turn: bool, mapper: Mapper) -> Iterator[Any]:
    """Yield what is taken of every state in the order of the programme.

    `in_turn` each load begins from what the one before has left, so that states of one pressure differ.
    """
    loading = [step for step in programme if step.unloaded_from is None]
    unloading = programme[len(loading) :]
    is_peak = [step.pressure in programme.unload_from for step in loading]
    after_peak: dict[float | None, _Solved] = {}
    elastic: dict[float, Any] = {}  # taken at a pressure at which no point has yielded
    states = _in_turn(stage, loading, mapper) if in_turn else mapper(stage, loading, is_peak)
    for step, solved in zip(loading, states, strict=True):
        after_peak[step.pressure] = replace(solved, taken=None)
        if step.pressure in programme.unloading and not (solved.has_yielded or in_turn):
            elastic[step.pressure] = solved.taken
        yield solved.taken

    def goes_back(step: LoadStep) -> bool:
        """Whether unloading to a step goes back along the loading."""
        return not (in_turn or after_peak[step.unloaded_from].has_yielded)

    new: list[LoadStep] = []
    for step in unloading:
        is_known = step.pressure in elastic or step.pressure in [
            other.pressure for other in new if goes_back(other)
        ]
        if not (goes_back(step) and is_known):
            new.append(step)
    peaks = [after_peak[step.unloaded_from] for step in new]
    states = mapper(stage, new, [False] * len(new), peaks) if new else ()
    at_new_steps = iter(states)
    for step in unloading:
        if not goes_back(step):
            yield next(at_new_steps).taken
            continue
        if step.pressure not in elastic:
            elastic[step.pressure] = next(at_new_steps).taken
        taken = elastic[step.pressure]
        is_state = isinstance(taken, LoadState)
        yield replace(taken, unloaded_from=step.unloaded_from) if is_state else taken
    next(at_new_steps, None)  # a mapper may have something to do at its end


def _in_turn(stage: Stage, loading: Sequence[LoadStep], mapper: Mapper) -> Iterator[_Solved]:
    """Solve the states of a loading, each from what the one before has left besides plastic deformation."""
    before = _NOTHING_BEFORE
    for step in loading:
        (solved,) = mapper(stage, [step], [True], [before])
        before = replace(_NOTHING_BEFORE, remembered=solved.remembered)
        yield solved


def _state(
    step: LoadStep,
    is_peak: bool,
    before: _Solved = _NOTHING_BEFORE,
    *,
    solve: Callable[..., Contact],
    rtol: float,
    take: Callable[[LoadState], Any] | None,
    remember: Callable[[Contact], Any] | None,
) -> _Solved:
    """Solve a state after what the peak, or the load before, has left."""
    settings = {} if remember is None else {"former": before.remembered}
    deformation = before.deformation
    contact = solve(pressure=step.pressure, deformation=deformation, rtol=rtol, **settings)
    again = 0.0 if deformation is None else _yielded_again(contact, deformation, rtol)
    state = LoadState(step.pressure, step.unloaded_from, contact=contact, yielded_again=again)
    return _Solved(
        taken=state if take is None else take(state),
        deformation=contact.plastic_deformation if is_peak else None,
        remembered=None if remember is None else remember(contact),
        has_yielded=bool(contact.plastic_deformation.any()),
    )


def _yielded_again(contact: Contact, deformation: np.ndarray, rtol: float) -> float:
    """Fraction of points whose plastic deformation grew by more than the residual explains."""
    # the displacement of a pixel under the hardness is about pressure / stiffness
    spacing = contact.half_space.spacing
    depth = 4 * max(spacing) * float(contact.pressure.max()) / (np.pi * contact.half_space.modulus)
    grown = contact.plastic_deformation - deformation > 100 * rtol * depth
    return float(np.count_nonzero(grown) / grown.size)
