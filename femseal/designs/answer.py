"""The design answer for a case or a finished run: what pressures a seal needs, and what changes them most."""

import json
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np

from ..base import AnyPath, InputError, counted, to_si, to_text, validate, versions
from ..base.leak_rates import USUAL, check_classes, leak_classes
from ..case.case import Case
from ..case.reading import load_case
from ..case.values import Amount
from ..execution.run import no_progress
from ..fluids import leak_basis
from ..results import Results, open_results
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
    """Pressures that a seal needs in assembly and in service, and what changes its leakage most.

    Qmin(L) is the nominal pressure in assembly from which on the seal leaks no more than a class L allows,
    QSmin(L; Q_A) that to which it may fall after an assembly at Q_A, as EN 13555 and EN 1591-1 use them: along the
    loading, and along the unloading from Q_A; as computed, and with the whole 95 % interval of the run. It is the
    verdict of the report, see `results.verdict`. What a fraction of the drawn seals needs as computed stands beside:
    the interval contains their scatter already. Where loads relax (`relaxation` of the case), also the pressure in
    assembly from which on the class is kept with what relaxation leaves. Between load steps ln(leakage) is straight in
    ln(pressure); nothing is extrapolated.

    Parameters
    ----------
    what : a case or its file, or results or their folder; results are taken as they are, without solving.
    output : folder of the run and of the answer, where complete results of the same case are taken; None writes
        nothing, not even into the folder of results that are given.
    classes : leakage classes, or leakages with their unit, see `base.leak_rates`; those of the case unless given,
        else L0.01, L0.1 and L1. The test fluid decides on them where there is one.
    probability : fraction of the drawn seals of which the pressure is given beside, above 0 and below 1.
    assembly : pressures in assembly Q_A besides those that the case unloads from, [Pa] or as "300 MPa"; of results
        those that they hold.
    nominal_diameter : [m] or as "50 mm", for the rates of ISO 5208.
    solve : solve the case again with another hardness, for what no law gives; cases only.
    replace_results : compute the case where the folder holds results of another one, and replace these.
    workers : processes; all cores unless given. progress : see `run`.

    Raises
    ------
    InputError : the case, the folder or an argument cannot be used.

    Examples
    --------
    >>> answer = design("results/seal", classes=["L0.01"], probability=0.9)  # doctest: +SKIP
    >>> answer.requirements, answer.sensitivities  # doctest: +SKIP
    """
    probability = validate.tolerance("probability", probability)
    wanted = leak_classes(classes := tuple(classes))
    case = results = None
    if isinstance(what, Results):
        results = what
    elif not isinstance(what, Case) and Path(what).is_dir():
        results = open_results(what)
    else:
        case = what if isinstance(what, Case) else load_case(what)
    extra = [to_si(q, "Pa", "assembly") if isinstance(q, str) else float(q) for q in assembly]
    if isinstance(diameter := nominal_diameter, str):
        diameter = to_si(diameter, "m", "nominal_diameter")
    if diameter is not None:
        validate.number("nominal_diameter", diameter, unit="m")
    shown = progress or no_progress
    if results is None:
        assert case is not None
        case = _assembled(case, extra)
        if wanted:
            tested = case.output.test_fluid or case.fluid
            drop = tested.state.pressure_drop
            basis = leak_basis(tested.fluid, 1.0, pressure_drop=drop, **case.output.valve)
            check_classes(classes, diameter or case.output.nominal_diameter, basis)
        results = job.run(
            case,
            output,
            output is not None,
            workers,
            replace_results=replace_results,
            progress=shown,
        )
    seals = Seals.of_results(results)
    known = seals.steps.unload_from
    lacking = [q for q in extra if not np.isclose(q, known, rtol=1e-9).any()]
    if case is None and lacking:
        peaks, others = (", ".join(to_text(p, "Pa") for p in each) for each in (known, lacking))
        expected = f"those that the run is unloaded from, {peaks or 'none'}; others take its case"
        raise InputError("assembly", others, expected)
    if not seals.count:
        raise InputError(
            "results",
            "no seal whose leakage is known at every load",
            "results without such failures",
        )
    data = results.dataset
    wanted = wanted or leak_classes(
        data["leak_class"].values.tolist() if "leak_class" in data.coords else USUAL
    )
    diameter = diameter or data.attrs.get("nominal_diameter_m")
    limits = [(one.name, one.limit(results.class_basis, diameter)) for one in wanted]
    relaxation = float(results.case.get("load", {}).get("relaxation", 0.0))
    needs = tuple(requirement(seals, *limit, probability, relaxation) for limit in limits)
    place = _place(needs, seals, probability)
    yields = bool(np.isfinite(data.attrs["hardness_Pa"]))
    variants, notes = Variants(hardness_counts=yields), _notes(seals, probability, results)
    if case is None and solve:
        notes.append(
            "of results nothing is solved again: femseal design CASE.toml gives the hardness too"
        )
    known_load = np.isfinite(place[1])
    if case is not None and solve and known_load:
        if (former := json.loads(data.attrs["versions"]).get("femseal")) != versions()["femseal"]:
            notes.append(
                f"the run is of femseal {former}: what is solved again may differ from it for that reason too"
            )
        variants = solved_variants(case, results, workers, shown)
    if (state := state_of_classes(results)) is not None:
        variants = replace(variants, law_length=state.law.length, inlet_slope=inlet_slope(state))
    answer = Design(
        results=results,
        seals=seals,
        probability=probability,
        requirements=needs,
        relaxation=relaxation,
        sealing=sealing_load(seals),
        at=place,
        sensitivities=sensitivities(seals, variants, place[1], probability) if known_load else (),
        notes=tuple(notes),
    )
    if output is not None:
        answer.write(output)
    return answer


def _assembled(case: Case, extra: list[float]) -> Case:
    """The case with more pressures from which it is unloaded."""
    if not extra:
        return case
    load, least = case.load, min(case.load.unloading or case.load.loading)
    if load.unit != "Pa":
        raise InputError("assembly", to_text(extra[0], "Pa"), "none beside loads that are forces")
    for q in extra:
        if not least < q < case.law.capacity:
            allowed = f"pressures above the lowest of the case, {to_text(least, 'Pa')}, and below the hardness"
            raise InputError("assembly", to_text(q, "Pa"), allowed)
    stops = load.unloading or tuple(reversed(load.loading))
    peaks = tuple(Amount(q, "Pa") for q in sorted({*load.unload_from, *extra}))
    return case.model_copy(
        update={"load": load.model_copy(update={"unload_from": peaks, "unloading": stops})}
    )


def _place(needs: tuple[Requirement, ...], seals: Seals, fraction: float) -> tuple[str, float]:
    """Class and load of the sensitivities: Qmin of the first class that has one, else half way over the open loads."""
    for need in needs:
        if np.isfinite(need.assembly.at):
            return need.name, need.assembly.at
    steps = seals.falling()
    pressure, leak = seals.steps.pressures[steps], seals.curve_of(fraction)[steps]
    open_ = pressure[(pressure > 0) & (leak > 0) & np.isfinite(leak)]
    return "", float(np.sqrt(open_[0] * open_[-1])) if open_.size > 1 else np.nan


def _notes(seals: Seals, fraction: float, results: Results) -> list[str]:
    """What to keep in mind of few seals, no unloading, warnings and failures."""
    notes = []
    tail = min(fraction, 1 - fraction)
    if seals.count == 1:
        notes.append("one seal: its figures have no probability; a stochastic run draws many")
    elif seals.count * tail < 1 - 1e-9:
        notes.append(
            f"{seals.count} seals are few for the fraction {fraction:g}: it takes at least {round(1 / tail)}"
        )
    if results.budget is None:
        notes.append(
            "without an error budget the pressures are those of the leakage as computed: set output.budget = true"
        )
    if not seals.steps.unload_from:
        notes.append(
            "the case is not unloaded: QSmin takes `unload_from`, or --assembly with a case"
        )
    if doubts := len(results.warnings):
        notes.append(f"the run has {counted(doubts, 'warning')}, which its report lists")
    if unknown := int(np.isinf(seals.leakage).any(axis=0).sum()):
        why = "what is computed as sealed may leak, or the fluid carries the load alone"
        notes.append(f"{counted(unknown, 'load')} counted as leaking: {why}")
    lost = results.dataset.sizes.get("realisation", seals.count) - seals.count
    if lost > 0 and results.method == "median":
        notes.append(f"without {counted(lost, 'seal')} that failed at some load")
    return notes
