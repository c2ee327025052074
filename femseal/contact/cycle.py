"""Solve the contact along a load programme, including the plastic deformation that remains after each peak load.

Contact states of first loading do not depend on the loading history. For an unloading, let u₀ be the plastic
deformation at the peak load. It is added to the undeformed gap, and the contact law becomes H(u + u₀). At the peak load
itself, this modified problem has the same solution as the contact on first loading. Reloading follows the unloading
curve up to the peak load. Above the peak load, reloading follows the curve of first loading (Sahlin et al., Proc.
IMechE J 224, 2010, 335; Pérez-Ràfols et al., 2018).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from math import inf
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..base import Mapper, Plotted, Stage, TextTable, to_text, validate
from ..loads import LoadProgramme, LoadStep
from .half_space import HalfSpace
from .law import ContactLaw
from .linear_laws import contact_law
from .solver import Contact, check_capacity, solve_contact

#: Number of arrays over all points that are needed to solve a state, including gap, plastic deformation and result.
STATE_FIELDS = 20


@dataclass(frozen=True, eq=False)
class _SolvedStep:
    """A solved load step.

    output : value that `take` has returned for the contact state, or the `LoadState` if `take` is None.
    deformation : plastic deformation (n1, n2) [m] if the step is a peak load, from which unloading begins; None for
        other steps.
    memory : return value of `remember` for this contact, to be passed to the next load step.
    has_yielded : whether any point has deformed plastically.
    """

    output: Any
    deformation: np.ndarray | None = None
    memory: Any = None
    has_yielded: bool = False


_NOTHING_BEFORE = _SolvedStep(output=None)


@dataclass(frozen=True, repr=False)
class LoadState(LoadStep, Plotted):
    """A step of a load programme, with the solution of the contact at this load step.

    Parameters
    ----------
    contact : Contact
        Solution of the contact at the load step.
    yielded_again : float
        Fraction of the points that yield during unloading. Unloading shifts contact pressure from some points to
        others. Points that were elastic at the peak load may therefore yield.
    """

    contact: Contact = field(kw_only=True)
    yielded_again: float = field(default=0.0, kw_only=True, metadata={"unit": "1"})

    def __repr__(self) -> str:
        return f"LoadState({self.name}, {self.contact!r}, yielded_again {self.yielded_again:.3g})"

    def _repr_html_(self) -> str:
        return f"<p>{self.name}</p>\n{self.contact._repr_html_()}"


class LoadCycle(tuple[LoadState, ...], Plotted):
    """States of a load cycle as a tuple, which can be displayed as a table and plotted."""

    __slots__ = ()

    def __repr__(self) -> str:
        texts = [f"{state.name}: contact {state.contact.area_fraction:.1%}" for state in self]
        return f"LoadCycle({', '.join(texts)})"

    def _repr_html_(self) -> str:
        """Return a table of the states for notebooks."""
        heads = ("step", "in contact", "at hardness", "mean gap", "residual")
        lines = []
        for state in self:
            contact = state.contact
            line = (
                state.name,
                f"{contact.area_fraction:.1%}",
                f"{contact.plastic_fraction:.1%}",
                to_text(contact.mean_gap, "m"),
                f"{contact.residual:.1e}",
            )
            lines.append(line)
        return TextTable("load cycle", heads, tuple(lines))._repr_html_()


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
    """Solve the contact along a loading curve, and along any number of unloading curves that start from it.

    Parameters
    ----------
    gap0 : array (n1, n2)
        Undeformed gap [m].
    half_space : HalfSpace
        Elastic body and grid.
    loading : sequence of float
        Nominal pressures of first loading [Pa].
    unload_from : sequence of float
        Peak pressures [Pa], from which the seal is unloaded.
    unloading : sequence of float
        Nominal pressures [Pa] to which the seal is unloaded from each peak pressure, see `LoadProgramme.of`.
    hardness : float, array (n1, n2) or ContactLaw
        Hardness [Pa], or a contact law, see `solve_contact`.
    rtol : float
        Target residual of each solution, see `solve_contact`.

    Returns
    -------
    LoadCycle
        Contact states in the order of the load steps. At unloading steps, `plastic_deformation` is the deformation at
        the peak load plus what has been added during the unloading.

    Raises
    ------
    InputError, NotConverged
        See `solve_contact`. All loads are checked before the contact at the first load is solved.

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
    """Return a function that solves the contact at a given load, after checking the gap, the law and all loads.

    Parameters
    ----------
    gap0 : array (n1, n2)
        Undeformed gap [m].
    half_space : HalfSpace
        Elastic body and grid.
    programme : LoadProgramme
        The load steps.
    law : ContactLaw
        Contact law.
    solve : callable
        Function with the arguments of `solve_contact`. It can, for example, account for a fluid between the surfaces.

    Returns
    -------
    callable
        The function `solve`, to which gap, half-space and law have already been passed. The caller has to pass the
        argument `pressure`, and may pass further arguments of `solve_contact`.
    """
    law.tangent(half_space.shape)  # raises InputError if the law has arrays of another shape
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
    """Solve the contact states of a load programme.

    If no point has yielded at a peak load, unloading follows the loading curve. In that case, if the pressure of an
    unloading step was already solved during loading, the output of the loading step is yielded again. Only outputs that
    may be needed again remain in memory.

    Parameters
    ----------
    programme : LoadProgramme
        The load steps.
    solve : callable
        Function that solves the contact at a load, see `contact_at_loads`.
    rtol : float
        Target residual of each solution, see `solve_contact`.
    take : callable, optional
        Function of a `LoadState`, called in the process that has solved the state. The value that `take` returns is
        yielded instead of the state.
    remember : callable, optional
        Function that takes a `Contact` and returns whatever the next load step needs besides the plastic deformation.
        The value that `remember` returns is passed to `solve` at the next load step as the argument `remembered`. If
        `remember` is given, the steps of first loading are solved one after another.
    memory : float
        Memory that is needed to solve a state and to call `take` [byte]. The required memory limits the number of
        states that are solved at the same time.
    mapper : callable
        Function like `map` that solves several independent load steps, for example in parallel. `mapper` is first
        called with all steps of first loading or, if `remember` is given, with each of these steps in turn. It is then
        called with all steps of unloading that have to be solved, if there are any.

    Yields
    ------
    LoadState, or the result of `take`
        One item for each load step, in the order of the programme.
    """
    solve_step = partial(_solve_step, solve=solve, rtol=rtol, take=take, remember=remember)
    stage = Stage("contact of the whole face", solve_step, memory)
    return _solve_programme(stage, programme, remember is not None, mapper)


def _solve_programme(
    stage: Stage, programme: LoadProgramme, one_after_another: bool, mapper: Mapper
) -> Iterator[Any]:
    """Yield the output of each contact state in the order of the programme.

    one_after_another : whether each step of first loading depends on the step before. If so, the states depend on the
        loading history, and a state of first loading is never reused during unloading.
    """
    loading = [step for step in programme if step.unloaded_from is None]
    unloading = programme[len(loading) :]
    # solved steps of the loading by their pressure, without their outputs
    solved_loading: dict[float | None, _SolvedStep] = {}
    # outputs of states in which no point has yielded, by their pressure; unloading may yield them once more
    elastic_outputs: dict[float, Any] = {}

    # solve the loading
    states: Iterable[_SolvedStep]
    if one_after_another:
        states = _solve_one_after_another(stage, loading, mapper)
    else:
        is_peak = [step.pressure in programme.unload_from for step in loading]
        states = mapper(stage, loading, is_peak)
    for step, solved in zip(loading, states, strict=True):
        solved_loading[step.pressure] = replace(solved, output=None)
        is_elastic = not (solved.has_yielded or one_after_another)
        if is_elastic and step.pressure in programme.unloading:
            elastic_outputs[step.pressure] = solved.output
        yield solved.output

    yield from _solve_unloading(
        stage, unloading, solved_loading, elastic_outputs, one_after_another, mapper
    )


def _solve_unloading(
    stage: Stage,
    unloading: Sequence[LoadStep],
    solved_loading: dict[float | None, _SolvedStep],
    elastic_outputs: dict[float, Any],
    one_after_another: bool,
    mapper: Mapper,
) -> Iterator[Any]:
    """Solve the unloading from all peak loads, and yield the output of each step.

    solved_loading : solved steps of first loading, by pressure.
    elastic_outputs : outputs of first loading in which no point has yielded, by pressure. The function adds the outputs
        of unloading steps that follow the loading curve.
    """

    def follows_loading(step: LoadStep) -> bool:
        """Return whether unloading to this step follows the loading curve, without any plastic deformation."""
        return not (one_after_another or solved_loading[step.unloaded_from].has_yielded)

    # choose the unloading steps to solve: a pressure on the loading curve is solved only once
    steps_to_solve: list[LoadStep] = []
    for step in unloading:
        elastic_pressures = [other.pressure for other in steps_to_solve if follows_loading(other)]
        is_known = step.pressure in elastic_outputs or step.pressure in elastic_pressures
        if not (follows_loading(step) and is_known):
            steps_to_solve.append(step)
    # solve these steps; the mapper returns them in the order of `steps_to_solve`
    solved_peaks = [solved_loading[step.unloaded_from] for step in steps_to_solve]
    solved_steps: Iterator[_SolvedStep] = iter(())
    if steps_to_solve:
        is_peak = [False] * len(steps_to_solve)
        solved_steps = iter(mapper(stage, steps_to_solve, is_peak, solved_peaks))
    # yield the outputs of all unloading steps in their order, some of them a second time
    for step in unloading:
        if not follows_loading(step):
            yield next(solved_steps).output
            continue
        if step.pressure not in elastic_outputs:
            elastic_outputs[step.pressure] = next(solved_steps).output
        output = elastic_outputs[step.pressure]
        if isinstance(output, LoadState):
            output = replace(output, unloaded_from=step.unloaded_from)
        yield output
    next(solved_steps, None)  # exhaust the mapper, so that the code after its last result runs, too


def _solve_one_after_another(
    stage: Stage, loading: Sequence[LoadStep], mapper: Mapper
) -> Iterator[_SolvedStep]:
    """Solve the steps of first loading in order, and pass the value that `remember` returns to the next step."""
    before = _NOTHING_BEFORE
    for step in loading:
        (solved,) = mapper(stage, [step], [True], [before])
        before = replace(_NOTHING_BEFORE, memory=solved.memory)
        yield solved


def _solve_step(
    step: LoadStep,
    is_peak: bool,
    before: _SolvedStep = _NOTHING_BEFORE,
    *,
    solve: Callable[..., Contact],
    rtol: float,
    take: Callable[[LoadState], Any] | None,
    remember: Callable[[Contact], Any] | None,
) -> _SolvedStep:
    """Solve the contact state of one load step.

    is_peak : whether to include the plastic deformation in the result, as needed for unloading from this step.
    before : at unloading steps, the solved step at the peak load; otherwise, the previous step of first loading.
    """
    options = {} if remember is None else {"remembered": before.memory}
    deformation = before.deformation
    contact = solve(pressure=step.pressure, deformation=deformation, rtol=rtol, **options)
    yielded_again = 0.0
    if deformation is not None:
        yielded_again = _fraction_yielded_again(contact, deformation, rtol)
    state = LoadState(
        step.pressure, step.unloaded_from, contact=contact, yielded_again=yielded_again
    )
    return _SolvedStep(
        output=state if take is None else take(state),
        deformation=contact.plastic_deformation if is_peak else None,
        memory=None if remember is None else remember(contact),
        has_yielded=bool(contact.plastic_deformation.any()),
    )


def _fraction_yielded_again(contact: Contact, deformation: np.ndarray, rtol: float) -> float:
    """Compute the fraction of points whose plastic deformation exceeds the earlier `deformation` (n1, n2) [m].

    An increase counts only if it is larger than the error of the solution.
    """
    # The error of the deformation is estimated as 100 · rtol times the elastic displacement of a single pixel under the
    # largest pressure, p/c with c = πE*/(4Δ).
    half_space = contact.half_space
    largest_pressure = float(contact.pressure.max())
    depth = 4 * max(half_space.spacing) * largest_pressure / (np.pi * half_space.pixel_modulus)
    has_grown = contact.plastic_deformation - deformation > 100 * rtol * depth
    return float(np.count_nonzero(has_grown) / has_grown.size)
