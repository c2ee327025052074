"""Answer the questions of a design for a case or a finished run: what pressures a seal needs, and what changes them."""

import json
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ..base import AnyPath, InputError, counted, to_si, to_text, validate, versions
from ..base.leak_rates import USUAL, LeakClass, check_classes, leak_classes
from ..case.case import Case
from ..case.quantity_types import Amount
from ..case.reading import load_case
from ..execution.run import no_progress
from ..fluids import leak_basis
from ..results import Results, open_results
from ..results.load_steps import force_scale
from ..runs import job
from .data_sheet import Design
from .requirements import Requirement, Seals, requirement, sealing_load
from .sensitivities import Variants, inlet_slope, sensitivities, solved_variants, state_of_classes


def design(
    what: Case | Results | AnyPath,
    output: AnyPath | None = None,
    *,
    classes: Iterable[str] = (),
    probability: float = 0.95,
    assembly: Iterable[float | str] = (),
    nominal_diameter: float | str | None = None,
    solve: bool = True,
    replace_results: bool = False,
    workers: int | None = None,
    progress: job.Progress | None = None,
) -> Design:
    """Find the pressures that a seal needs in assembly and in service, and what changes its leakage most.

    As in EN 13555 and EN 1591-1, Qmin(L) is the nominal pressure in assembly from which on the seal leaks no more than
    a class L allows. QSmin(L; Q_A) is the pressure to which it may fall in service after an assembly at Q_A. Qmin is
    read from the loading, QSmin from the unloading from Q_A, each by the leakage as computed and by the upper end of
    its 95 % interval. These are the loads of the verdict in the report, see `results.verdict`.

    A second column gives the pressure that a fraction of the realisations needs as computed; the 95 % interval
    contains the scatter between realisations already. If the case has a `relaxation`, the answer also has the pressure
    in assembly from which on the class is still met after relaxation. Between load steps, ln(leakage) is interpolated
    linearly over ln(pressure); nothing is extrapolated.

    Parameters
    ----------
    what : Case, Results or path
        A case or its file, which is run; or results or their folder, which are taken as they are.
    output : path, optional
        Folder for the run and the answer. Complete results of the same case in this folder are taken. Nothing is
        written unless given, not even into the folder of results.
    classes : iterable of str
        Leakage classes, or leakages with their unit, see `base.leak_rates`. Unless given, those of the case, or else
        L0.01, L0.1 and L1. The leakage of the test fluid decides if the case has one.
    probability : float
        Fraction of the realisations of the second column, above 0 and below 1.
    assembly : iterable of float or str
        Loads in assembly Q_A besides those that the case is unloaded from, in SI or as texts such as "300 MPa"; forces,
        such as "60 kN", if the loads of the case are forces.
        Results must contain them already.
    nominal_diameter : float or str, optional
        Nominal diameter [m] for the rates of ISO 5208, or a text such as "50 mm".
    solve : bool
        Whether a case is solved again with another hardness and another length of the flow law, because these two
        sensitivities follow from no scaling law.
    replace_results : bool
        Whether results of another case in the folder are replaced.
    workers : int, optional
        Number of processes; one for each core unless given.
    progress : callable, optional
        See `run`.

    Returns
    -------
    Design

    Raises
    ------
    InputError
        The case, the folder or an argument cannot be used.

    Examples
    --------
    >>> answer = design("results/seal", classes=["L0.01"], probability=0.9)  # doctest: +SKIP
    >>> answer.requirements, answer.sensitivities  # doctest: +SKIP
    """
    probability = validate.tolerance("probability", probability)
    class_names = tuple(classes)
    wanted_classes = leak_classes(class_names)
    case, results = _case_or_results(what)
    assembly_loads = _loads_in_assembly(case, results, assembly)
    diameter = None
    if nominal_diameter is not None:
        diameter = _in_si("nominal_diameter", nominal_diameter, "m")
        validate.number("nominal_diameter", diameter, unit="m")
    report_progress = progress or no_progress
    if results is None:
        assert case is not None
        case = _with_assembly_loads(case, assembly_loads)
        if class_names:
            _check_classes_of_case(case, class_names, diameter)
        results = job.run(
            case,
            output,
            output is not None,
            workers,
            replace_results=replace_results,
            progress=report_progress,
        )
    seals = Seals.of_results(results)
    if case is None:
        _check_unloaded_from(seals, _as_pressures(results, assembly_loads))
    if not seals.count:
        given = "no realisation whose leakage is known at every load"
        raise InputError("results", given, "results with at least one such realisation")
    limits = _class_limits(results, wanted_classes, diameter)
    relaxation = float(results.case.get("load", {}).get("relaxation", 0.0))
    requirements = tuple(
        requirement(seals, name, limit, probability, relaxation) for name, limit in limits.items()
    )
    load = _load_of_sensitivities(requirements, seals, probability)
    notes = _notes(seals, probability, results)
    variants = Variants(hardness_counts=bool(np.isfinite(results.dataset.attrs["hardness_Pa"])))
    if solve and case is None:
        notes.append(
            "results are not solved again, so that the sensitivity to hardness is unknown: femseal design CASE.toml "
            "gives it"
        )
    elif solve and case is not None and load.is_known:
        notes += _note_on_version(results)
        variants = solved_variants(case, results, workers, report_progress)
    variants = _with_fluid(variants, results)
    answer = Design(
        results=results,
        seals=seals,
        probability=probability,
        requirements=requirements,
        relaxation=relaxation,
        sealing=sealing_load(seals),
        at=(load.class_name, load.pressure),
        sensitivities=(
            sensitivities(seals, variants, load.pressure, probability) if load.is_known else ()
        ),
        notes=tuple(notes),
    )
    if output is not None:
        answer.write(output)
    return answer


def _case_or_results(what: Case | Results | AnyPath) -> tuple[Case | None, Results | None]:
    """Load the case or the results that the user named; the other one is None."""
    if isinstance(what, Results):
        return None, what
    if isinstance(what, Case):
        return what, None
    if Path(what).is_dir():
        return None, open_results(what)
    return load_case(what), None


def _in_si(name: str, value: float | str, unit: str) -> float:
    """Convert a number in SI, or a text with a unit, to SI."""
    return to_si(value, unit, name) if isinstance(value, str) else float(value)


def _loads_in_assembly(
    case: Case | None, results: Results | None, loads: Iterable[float | str]
) -> list[float]:
    """Convert loads in assembly to SI, in the unit of the loads of the case: Pa, N or N/m."""
    unit = "Pa"
    if case is not None:
        unit = case.load.unit
    elif results is not None and (scale := force_scale(results.dataset)) is not None:
        unit = "N/m" if scale.unit == "N/mm" else "N"
    return [_in_si("assembly", load, unit) for load in loads]


def _as_pressures(results: Results, loads: list[float]) -> list[float]:
    """Convert loads in the unit of the case of a run to nominal pressures [Pa]."""
    scale = force_scale(results.dataset)
    if scale is None:
        return loads
    per_pascal = scale.per_pascal * (1.0 if scale.unit == "N" else 1e3)
    return [load / per_pascal for load in loads]


def _with_assembly_loads(case: Case, loads: list[float]) -> Case:
    """Let a case be unloaded from further loads, in the unit of its loads.

    Raises
    ------
    InputError
        A load is outside the loads that the case can have.
    """
    if not loads:
        return case
    table = case.load
    unit = table.unit
    lowest = min(table.unloading or table.loading)
    # forces are compared with the hardness when the size of the seal is known
    highest = case.law.capacity if unit == "Pa" else np.inf
    name = "pressures" if unit == "Pa" else "forces"
    for load in loads:
        if not lowest < load < highest:
            below = ", and below the hardness" if np.isfinite(highest) else ""
            expected = f"{name} above the lowest of the case, {to_text(lowest, unit)}{below}"
            raise InputError("assembly", to_text(load, unit), expected)
    unload_from = tuple(Amount(load, unit) for load in sorted({*table.unload_from, *loads}))
    unloading = table.unloading or tuple(reversed(table.loading))
    changed = table.model_copy(update={"unload_from": unload_from, "unloading": unloading})
    return case.model_copy(update={"load": changed})


def _check_classes_of_case(
    case: Case, class_names: tuple[str, ...], diameter: float | None
) -> None:
    """Check that the leakage classes can be used for the fluid of the case before anything is solved."""
    fluid = case.output.test_fluid or case.fluid
    pressure_drop = fluid.state.pressure_drop
    basis = leak_basis(fluid.fluid, 1.0, pressure_drop=pressure_drop, **case.output.valve)
    check_classes(class_names, diameter or case.output.nominal_diameter, basis)


def _check_unloaded_from(seals: Seals, pressures: list[float]) -> None:
    """Check that results are unloaded from all pressures in assembly [Pa]; raise InputError if not."""
    known = seals.steps.unload_from
    missing = [p for p in pressures if not np.isclose(p, known, rtol=1e-9).any()]
    if not missing:
        return
    given = ", ".join(to_text(p, "Pa") for p in missing)
    known_texts = ", ".join(to_text(p, "Pa") for p in known) or "none"
    expected = f"those that the run is unloaded from, {known_texts}; for others, give the case instead of its results"
    raise InputError("assembly", given, expected)


def _class_limits(
    results: Results, wanted_classes: tuple[LeakClass, ...], diameter: float | None
) -> dict[str, float]:
    """Find the largest leakage per length [m²/s] of each leakage class, by its name.

    The classes of the results are taken unless others are wanted, and the usual ones if they have none.
    """
    data = results.dataset
    if not wanted_classes:
        names = data["leak_class"].values.tolist() if "leak_class" in data.coords else USUAL
        wanted_classes = leak_classes(names)
    diameter = diameter or data.attrs.get("nominal_diameter_m")
    return {c.name: c.limit(results.class_basis, diameter) for c in wanted_classes}


@dataclass(frozen=True)
class _Load:
    """The load at which the sensitivities are given.

    class_name : leakage class whose Qmin it is, or "". pressure : nominal pressure [Pa], NaN if there is none.
    """

    class_name: str
    pressure: float

    @property
    def is_known(self) -> bool:
        """Whether there is such a load."""
        return bool(np.isfinite(self.pressure))


def _load_of_sensitivities(
    requirements: tuple[Requirement, ...], seals: Seals, fraction: float
) -> _Load:
    """Choose Qmin of the first class that has one, or else the geometric middle of the loads that leak."""
    for need in requirements:
        if np.isfinite(need.assembly.at):
            return _Load(need.name, need.assembly.at)
    steps = seals.falling()
    pressure = seals.steps.pressures[steps]
    leakage = seals.curve_of(fraction)[steps]
    leaking = pressure[(pressure > 0) & (leakage > 0) & np.isfinite(leakage)]
    if leaking.size < 2:
        return _Load("", np.nan)
    return _Load("", float(np.sqrt(leaking[0] * leaking[-1])))


def _with_fluid(variants: Variants, results: Results) -> Variants:
    """Add what the sensitivities need to know about the fluid that decides on leakage classes."""
    state = state_of_classes(results)
    if state is None:
        return variants
    return replace(variants, law_length=state.law.length, inlet_slope=inlet_slope(state))


def _note_on_version(results: Results) -> list[str]:
    """Note that the results were computed by another version of femseal, if they were."""
    version = json.loads(results.dataset.attrs["versions"]).get("femseal")
    if version == versions()["femseal"]:
        return []
    return [
        f"the run was computed by femseal {version}: part of the sensitivity to hardness may come from the change of "
        "version"
    ]


def _notes(seals: Seals, fraction: float, results: Results) -> list[str]:
    """List what the user should keep in mind about the answer."""
    notes = []
    smaller_fraction = min(fraction, 1 - fraction)
    if seals.count == 1:
        notes.append(
            "the run has one seal, so that its figures have no probability; a stochastic run has many realisations"
        )
    elif seals.count * smaller_fraction < 1 - 1e-9:
        notes.append(
            f"{seals.count} realisations are too few for the fraction {fraction:g}: at least "
            f"{round(1 / smaller_fraction)} are needed"
        )
    if results.budget is None:
        notes.append(
            "without an error budget the pressures are those of the leakage as computed: set output.budget = true to "
            "include the 95 % interval"
        )
    if not seals.steps.unload_from:
        notes.append(
            "QSmin is missing because the case is not unloaded: set load.unload_from, or give --assembly with the case"
        )
    n_warnings = len(results.warnings)
    if n_warnings:
        notes.append(f"the run gave {counted(n_warnings, 'warning')}, which its report lists")
    n_unknown = int(np.isinf(seals.leakage).any(axis=0).sum())
    if n_unknown:
        notes.append(
            f"{counted(n_unknown, 'load')} counted as leaking: a seal that is computed as tight may leak there, or "
            "the fluid carries the whole load"
        )
    n_failed = results.dataset.sizes.get("realisation", seals.count) - seals.count
    if n_failed > 0 and results.method == "median":
        notes.append(
            f"{counted(n_failed, 'realisation')} left out because the solution failed at some load"
        )
    return notes
