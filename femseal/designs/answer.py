"""Find the pressures at which a seal meets its leakage classes, and the sensitivities of its leakage.

The input is either a case, which is then run, or the results of a finished run.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ..base import AnyPath, InputError, counted, to_si, to_text, validate, versions
from ..base.leak_classes import check_classes, find_leak_classes
from ..case.case import Case
from ..case.quantity_types import Amount
from ..case.reading import load_case
from ..execution.run import no_progress
from ..fluids import leak_basis
from ..results import Results, open_results
from ..results.class_fluid import class_fluid
from ..results.load_steps import given_loads, load_format
from ..results.met_classes import class_limits
from ..runs import job
from .data_sheet import Design
from .requirements import Requirement, Seals, requirement, sealing_load
from .sensitivities import Variants, inlet_slope, sensitivities, solved_variants


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
    """Find the pressures that a seal needs in assembly and in service, and the sensitivities of its leakage.

    As in EN 13555 and EN 1591-1, Qmin(L) is the lowest nominal pressure in assembly at which the seal meets a leakage
    class L. QSmin(L; Q_A) is the lowest pressure to which the seal may be unloaded in service after assembly at Q_A.
    Qmin is read from the loading curve of leakage over pressure, and QSmin from the unloading curve from Q_A. Qmin and
    QSmin are given for the computed leakage and for the upper end of its 95 % interval. The verdict in the report
    states the same loads, see `results.verdict`.

    For a stochastic seal, the answer also gives the lowest pressure at which, for example, 95 % of the realisations
    meet the class. This pressure follows from the computed leakages alone, whereas the 95 % interval contains both the
    scatter between realisations and all other errors. If the case has a `relaxation`, the answer also contains the
    lowest pressure in assembly at which the seal still meets the class after relaxation. Between load steps,
    ln(leakage) is interpolated linearly over ln(pressure). There is no extrapolation.

    Parameters
    ----------
    what : Case, Results or path
        A case or a case file to run, or the results or results folder of a finished run.
    output : path, optional
        Folder in which the results of the run and the answer are stored. If the folder already contains complete
        results of the same case, they are used instead of a run. By default nothing is written, not even if `what` is a
        results folder.
    classes : iterable of str
        Leakage classes, or leakages with their unit, see `base.leak_rates`. Default: the classes of the case, or else
        L0.01, L0.1 and L1. If the case has a test fluid, the leakage of the test fluid is compared with the classes.
    probability : float
        Fraction of the realisations, above 0 and below 1, that must meet the class at the additional Qmin.
    assembly : iterable of float or str
        Further loads in assembly Q_A, from which the seal is unloaded, in SI or as texts such as "300 MPa". Give
        forces, such as "60 kN", if the loads of the case are forces. If `what` is the results of a run, this run must
        already contain the unloading from these loads.
    nominal_diameter : float or str, optional
        Nominal diameter for the rates of ISO 5208, in metres or as text such as "50 mm".
    solve : bool
        Whether to solve a case again, once with a slightly higher hardness, and once with a slightly larger length in
        the flow law (mean free path or slip length). The sensitivities to the hardness and to this length do not follow
        from a scaling law.
    replace_results : bool
        Whether to replace results of another case in the folder.
    workers : int, optional
        Number of processes. Default: one for each core.
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
    wanted_classes = find_leak_classes(class_names)
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
    seals = Seals.from_results(results)
    if case is None:
        _check_unloaded_from(seals, _as_pressures(results, assembly_loads))
    if not seals.count:
        given = "no realisation whose leakage is known at every load"
        raise InputError(
            "results",
            given,
            "results with at least one realisation whose leakage is known at every load",
        )
    limits = class_limits(results.dataset, wanted_classes, diameter)
    relaxation = float(results.case.get("load", {}).get("relaxation", 0.0))
    requirements = tuple(
        requirement(seals, name, limit, probability, relaxation) for name, limit in limits.items()
    )
    load = _choose_load_of_sensitivities(requirements, seals, probability)
    notes = _notes(seals, probability, results) + _note_on_load(load, results)
    variants = Variants(can_yield=bool(np.isfinite(results.dataset.attrs["hardness_Pa"])))
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
    """Return either the case or the results that the user has given as an object or a path.

    The other member of the returned pair is None.
    """
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
    """Convert loads in assembly to numbers, in the SI unit of the loads of the case: Pa, N or N/m."""
    unit = "Pa"
    if case is not None:
        unit = case.load.unit
    elif results is not None:
        unit, _ = given_loads(results.dataset)
    return [_in_si("assembly", load, unit) for load in loads]


def _as_pressures(results: Results, loads: list[float]) -> list[float]:
    """Convert loads to nominal pressures [Pa].

    loads : in the SI unit of the loads of the case, which is Pa, N or N/m.
    """
    unit, per_pascal, _digits = load_format(results.dataset)
    if not unit:
        return loads
    unit_in_si = 1.0 if unit == "N" else 1e3  # the other units are kN and N/mm
    load_per_pascal = per_pascal * unit_in_si
    return [load / load_per_pascal for load in loads]


def _with_assembly_loads(case: Case, loads: list[float]) -> Case:
    """Return a copy of a case with additional unloadings from the given loads.

    loads : in the SI unit of the loads of the case.

    Raises
    ------
    InputError
        A load is below the lowest load of the case, or above the hardness.
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
    """Raise InputError, before anything is solved, if a leakage class does not apply to the fluid of the case."""
    fluid = case.output.test_fluid or case.fluid
    pressure_drop = fluid.state.pressure_drop
    basis = leak_basis(fluid.fluid, 1.0, pressure_drop=pressure_drop, **case.output.valve)
    check_classes(class_names, diameter or case.output.nominal_diameter, basis)


def _check_unloaded_from(seals: Seals, pressures: list[float]) -> None:
    """Raise InputError unless the run contains an unloading from each given pressure in assembly [Pa]."""
    known = seals.steps.unload_from
    missing = [p for p in pressures if not np.isclose(p, known, rtol=1e-9).any()]
    if not missing:
        return
    given = ", ".join(to_text(p, "Pa") for p in missing)
    known_texts = ", ".join(to_text(p, "Pa") for p in known) or "none"
    expected = f"those that the run is unloaded from, {known_texts}; for others, give the case instead of its results"
    raise InputError("assembly", given, expected)


@dataclass(frozen=True)
class _Load:
    """Load at which the sensitivities are computed.

    class_name : leakage class if the load is Qmin of this class, otherwise "".
    pressure : nominal pressure [Pa]; NaN if the sensitivities cannot be computed at any load.
    replaced : requirement whose Qmin could not be used, because at this load the seal does not leak or its leakage is
        unknown; None if no Qmin had to be replaced.
    """

    class_name: str
    pressure: float
    replaced: Requirement | None = None

    @property
    def is_known(self) -> bool:
        """Whether there is a load at which the sensitivities can be computed."""
        return bool(np.isfinite(self.pressure))


def _choose_load_of_sensitivities(
    requirements: tuple[Requirement, ...], seals: Seals, fraction: float
) -> _Load:
    """Choose the load for the sensitivities.

    The load is Qmin of the first class whose Qmin lies within the loads of the case. If the leakage at this Qmin is 0
    or unknown, the closest load step with a known leakage above 0 is used. If no Qmin lies within the loads of the
    case, the geometric mean of the lowest and the highest loads at which the seal leaks during loading is used.
    """
    steps = seals.steps_from_highest()
    pressure = seals.steps.pressures[steps]
    leakage = seals.quantile_curve(fraction)[steps]
    is_leaking = (pressure > 0) & (leakage > 0) & np.isfinite(leakage)
    leaking_pressures = pressure[is_leaking]  # from the highest to the lowest
    if not leaking_pressures.size:
        return _Load("", np.nan)
    highest, lowest = leaking_pressures[0], leaking_pressures[-1]
    for need in requirements:
        needed = need.assembly.at
        if lowest <= needed <= highest:
            return _Load(need.name, needed)
        if np.isfinite(needed):
            closest = highest if needed > highest else lowest
            return _Load("", float(closest), replaced=need)
    if leaking_pressures.size < 2:
        return _Load("", np.nan)
    return _Load("", float(np.sqrt(highest * lowest)))


def _note_on_load(load: _Load, results: Results) -> list[str]:
    """Return a note if the sensitivities had to be computed at a load other than Qmin."""
    if load.replaced is None:
        return []
    load_text = load_format(results.dataset, 3).short
    needed = load.replaced.assembly.at
    if load.pressure < needed:
        which = "the highest load at which the seal leaks as computed"
        why = "no leakage path is open"
    else:
        which = "the lowest load whose leakage is known"
        why = "the leakage is unknown"
    return [
        f"the sensitivities hold at {load_text(load.pressure)}, {which}: at {load_text(needed)}, which "
        f"{load.replaced.name} needs, {why}"
    ]


def _with_fluid(variants: Variants, results: Results) -> Variants:
    """Return a copy of `variants` for the fluid to which the leakage classes apply."""
    state = class_fluid(results)
    if state is None:
        return variants
    return replace(
        variants, length_parameter=state.law.scale_parameter, inlet_slope=inlet_slope(state)
    )


def _note_on_version(results: Results) -> list[str]:
    """Return a note if another version of femseal computed the results."""
    version = json.loads(results.dataset.attrs["versions"]).get("femseal")
    if version == versions()["femseal"]:
        return []
    return [
        f"the run was computed by femseal {version}: part of the sensitivity to hardness may come from the change of "
        "version"
    ]


def _notes(seals: Seals, fraction: float, results: Results) -> list[str]:
    """List notes for the user on parts missing from the answer, and on results that were left out."""
    notes = []
    smaller_fraction = min(fraction, 1 - fraction)
    if seals.count == 1:
        notes.append(
            "the run has a single seal, so that no probability can be given; a stochastic run has many realisations"
        )
    elif seals.count * smaller_fraction < 1 - 1e-9:
        notes.append(
            f"{seals.count} realisations are too few for the fraction {fraction:g}: at least "
            f"{round(1 / smaller_fraction)} are needed"
        )
    if results.budget is None:
        notes.append(
            "without an error budget the pressures follow from the computed leakage alone: set output.budget = true "
            "to include the 95 % interval"
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
            f"{counted(n_unknown, 'load')} counted as leaking: a seal whose computed leakage is 0 may leak there, or "
            "the fluid carries the whole load"
        )
    n_failed = results.dataset.sizes.get("realisation", seals.count) - seals.count
    if n_failed > 0 and results.best_study.has_realisations:
        notes.append(
            f"{counted(n_failed, 'realisation')} left out because the solution failed at some load"
        )
    return notes
