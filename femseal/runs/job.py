"""One run of a case: prepare, compute each study, write the results folder; or take complete results that are there."""

from __future__ import annotations

import hashlib
import json
import logging
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from uuid import uuid4

from ..base import (
    AnyPath,
    FemsealError,
    InputError,
    Mapper,
    made_folder,
    numerical_versions,
    validate,
    writing,
)
from ..base.files import remove_foreign
from ..base.machine import storing
from ..budget import BudgetRequest, ErrorBudget, budgets_of
from ..case.case import Case
from ..case.output_table import FILE_KEYS
from ..case.reading import load_case
from ..case.table_types import makers_in
from ..checks import flow_warnings
from ..execution.resuming import (
    alone_in,
    begin_run,
    remove_run,
    resumable,
    store_folder,
    writing_in,
)
from ..execution.run import (
    LogFile,
    Progress,
    Run,
    logging_to,
    no_progress,
    ordered_map,
    reporting_compilation,
)
from ..preparation.preparation import Prepared, prepare
from ..refinement.refine_to_accuracy import (
    first_settings,
    first_version,
    last_version,
    refine_to_accuracy,
)
from ..report import write_again, write_folder
from ..results import Results, RunFacts, assemble, open_results
from ..results.dataset_file import FILE_NAME
from ..store.code import NoDigest, is_known
from ..store.digests import digest
from ..store.store import Store
from ..studies import FluidState, OtherLeakage, StochasticResult, drop_ratio
from ..studies.compiling import compile_ahead
from ..studies.study_registry import mean_gap_of
from .forecast import described, refuse_too_large, solids_text

log = logging.getLogger("femseal")


#: What divides the work of a run among machines, for those who ask for a part of it.
DIVIDED_BY_DASK = "start a Dask cluster and give its scheduler, as examples/slurm.sh does"


@validate.removed_arguments(part=DIVIDED_BY_DASK)
def run(
    case: Case | AnyPath,
    output: AnyPath | None = None,
    resume: bool = False,
    workers: int | None = None,
    scheduler: str | None = None,
    *,
    shared: AnyPath | None = None,
    replace_results: bool = False,
    progress: Progress | None = None,
) -> Results:
    """Run a case, from surface to leakage.

    Parameters
    ----------
    case : a `Case`, or the path of a case file.
    output : results folder, made if it does not exist; None writes nothing.
    resume : take the results from the folder if it holds those of the same case, complete and with the same choices
        where the case leaves them open; else go on from the store of a run that was ended, with the same bits.
    workers : processes; all cores unless given. The results do not depend on it.
    scheduler : address of a Dask scheduler to compute on instead (femseal[cluster]), or "local" for one of its own
        with `workers` processes, see `execution.run.ordered_map`.
    replace_results : compute the case where the folder holds results of a finished run, whose files are replaced.
    shared : folder with results of stages, where a run keeps its own and finds those of other runs that do the same
        with the same numbers; it grows with every run.
    progress : called as progress(stage, done, total) while states and realisations are computed.

    Raises
    ------
    InputError : the case or an argument cannot be used, the run is expected to take more memory than there is, the
        folder holds the results of a finished run, with `resume` those of another case, or an unfinished run of another
        case, other face files or other versions, or one without `resume`, or another run is under way there; nothing
        has been written then.
    FemsealError : a computation failed as a whole, or a file could not be written: computed items stay in the
        folder, and `resume` continues from them. Single cells that fail are listed in `Results.failures`.

    Examples
    --------
    >>> results = run("seal.toml", "results/seal", workers=2)  # doctest: +SKIP
    >>> results.loading().leakage_total, results.leakage_in("mL/min"), results.warnings  # doctest: +SKIP
    """
    if not isinstance(case, Case):
        case = load_case(case)
    if workers is not None and (not isinstance(workers, int) or workers < 1):
        raise InputError("workers", workers, "a whole number >= 1, or None for all cores")
    folder = checked_output(output, resume)
    faces = face_files(case)
    # options of the output may change before a run is resumed
    echo = case.echo()
    echo |= {"output": {"test_fluid": echo["output"].get("test_fluid")}}
    identity = echo | {"content of face files": faces, "version": numerical_versions()}
    identity |= user_code(case)
    if resume and folder is not None and (finished := finished_results(case, faces, folder)):
        with suppress(InputError), alone_in(folder):  # the store of another run stays
            resumable(folder, identity)
            remove_run(folder)
        return finished
    if folder is not None and not replace_results:
        refuse_finished(folder, case if resume else None)
    progress = progress or no_progress

    with ExitStack() as stack:
        enter = stack.enter_context
        enter(storing(folder, case.memory))
        enter(reporting_compilation(progress))
        # a folder is made once the case has been found good
        if there := folder is not None and folder.is_dir():
            going_on = enter(writing_in(folder, identity, resume))
        prepared = prepare(case)
        if scheduler is None:
            refuse_too_large(case, prepared)
        mapper = enter(ordered_map(workers, scheduler, partial(compile_ahead, progress=progress)))
        if folder is None:
            kept = Path(enter(TemporaryDirectory()) if shared is None else shared)
            store = enter(Store(kept, required=False))
            return _results(case, prepared, faces, Run(store.over(mapper), progress))
        if not there:
            going_on = enter(writing_in(made_folder(folder), identity, resume))
        enter(_log_file(folder, append=going_on))
        if going_on:
            log.info("resumed from %s", store_folder(folder))
        begin_run(folder, identity)
        store = enter(Store(Path(shared or store_folder(folder))))
        results = _results(case, prepared, faces, Run(store.over(mapper), progress))
        progress("writing results", 0, None)
        # the pictures are small, and drawn on this machine
        _write(results, folder, case, mapper if scheduler is None else map)
        for text in results.left_out:
            log.info("left out: %s", text)
        log.info("results in %s", folder)
        return replace(results, folder=folder)


def checked_output(output: AnyPath | None, resume: bool) -> Path | None:
    """Return the output folder as a path, None where nothing is written.

    Raises
    ------
    InputError : the output is a file, or there is no folder whose run could be resumed.
    """
    folder = None if output is None else Path(output)
    if folder is not None and folder.exists() and not folder.is_dir():
        expected = "a folder, or one that does not exist"
        raise InputError("output", f"'{folder}', which is a file", expected)
    if resume and folder is None:
        raise InputError("resume", resume, "an output folder with it")
    return folder


@contextmanager
def _interrupts() -> Iterator[None]:
    """Raise KeyboardInterrupt for a Ctrl-C within compiled code, which numba reports as SystemError."""
    try:
        yield
    except SystemError as error:
        cause: BaseException | None = error
        while isinstance(cause, SystemError):
            cause = cause.__cause__
        if isinstance(cause, KeyboardInterrupt):
            raise KeyboardInterrupt from error
        raise


@_interrupts()
def _results(case: Case, made: Prepared, faces: dict[str, str], run: Run) -> Results:
    """Solve the studies of a prepared case, and put their results together."""
    log.info("case %s: surface %s", case.title or "without title", made.scene.surface)
    form_effect = made.solve_form_effect()
    prepared, studies, refined = made, {}, None
    if case.accuracy is not None:
        refined = refine_to_accuracy(case, made, run)
        prepared, studies[made.answer.key] = refined.prepared, refined.result
    for study in prepared.solved_studies:
        if study.key not in studies:
            with run.timed(study.name) as mapper:
                studies[study.key] = prepared.solve(study, mapper)
    if {"deterministic", "two-scale"} <= prepared.methods:
        studies["deterministic"] = studies["two_scale"].without_cells
    test = None
    test_warnings: tuple[str, ...] = ()
    if (fluid := case.output.test_fluid) is not None:
        answer = studies[prepared.answer.key]
        test = _of_test_fluid(fluid.state, prepared, answer, run)
        tested_scene = fluid.state.in_scene(prepared.scene)
        texts = flow_warnings(tested_scene, test.leakage, mean_gap_of(answer))
        test_warnings = tuple(f"Test fluid: {text}" for text in texts)
    budgets: dict[str, ErrorBudget] = {}
    if case.output.budget:  # last, so that it can be switched before a run is resumed
        known = {} if refined is None else {prepared.answer.key: refined.budget}
        request = BudgetRequest(
            prepared, case.output.model_parts, case.hardness_tolerance, form_effect
        )
        with run.timed("error budget") as mapper:
            budgets = budgets_of(request, studies, mapper, known)
    estimate = studies[prepared.answer.key].quick_estimate
    description = [*described(case, prepared, estimate, form_effect)]
    attributes = {
        "seat": prepared.seat,
        "face_files": json.dumps(faces),
        "solids": solids_text(case),
        "description": json.dumps(description, ensure_ascii=False),
        "chosen": json.dumps(_chosen(case, made)),
    }
    warnings = prepared.warnings
    if form_effect is not None:
        warnings += tuple(form_effect.warnings)
    warnings += test_warnings
    if refined is not None:
        warnings += refined.warnings
        attributes["accuracy"] = json.dumps(refined.as_data(budgets[prepared.answer.key]))
    facts = RunFacts(
        case=case.echo(),
        surface=prepared.surface_report,
        timings=run.timings,
        quantiles=case.stochastic.quantiles if case.stochastic else (0.05, 0.95),
        warnings=warnings,
        budgets=budgets,
        test=test,
        valve=case.output.valve,
        attributes=attributes,
        **case.output.model_dump(
            include={"leakage_unit", "classes", "nominal_diameter", "throughput_temperature"}
        ),
    )
    results = assemble(prepared.scene, *studies.values(), facts=facts)
    for text in [*results.warnings, *results.failures]:
        log.warning("%s", text)
    return results


def _of_test_fluid(state: FluidState, prepared: Prepared, own: Any, run: Run) -> OtherLeakage:
    """Leakage of the test fluid on the seals of the answer; they are solved again where their permeability differs."""
    if (ratio := drop_ratio(state, prepared.scene)) is not None:
        return OtherLeakage.of_study(state, own, ratio)
    same_seals = prepared
    if isinstance(own, StochasticResult):
        same_seals = prepared.with_realisations(len(own.leakage))
    other = replace(same_seals, scene=state.in_scene(prepared.scene))
    with run.timed("test fluid") as mapper:
        return OtherLeakage.of_study(state, other.solve(other.answer, mapper))


def _write(results: Results, folder: Path, case: Case, mapper: Mapper) -> None:
    """Write the folder of results; then the store of the run goes."""
    try:
        surface = None if results.scene is None else results.scene.surface
        write_folder(results, folder, surface, mapper=mapper, **case.output.files)
    except Exception as error:
        known = isinstance(error, FemsealError)
        reason = str(error) if known else f"results: {error or type(error).__name__}"
        text = f"{reason}; mend that, then a run with --resume has only to write them"
        raise FemsealError(text) from error
    remove_run(folder)


def face_files(case: Case) -> dict[str, str]:
    """SHA-256 of the file of every face, of its mask, of seal, seat and maps, by its path in the case."""
    digests = {}
    for key, path in case.files():
        try:
            with (case.folder / path).open("rb") as file:
                digests[str(path)] = hashlib.file_digest(file, "sha256").hexdigest()
        except OSError as error:
            expected = f"a file that can be read ({error.strerror})"
            raise InputError(key, f"'{path}'", expected) from None
    return digests


def user_code(case: Case) -> dict[str, str]:
    """Return a digest of the code of the fluids, seal shapes, seats and forms of a case that a user has registered.

    The dictionary is empty where all of them are femseal's, whose version is known. Where the code cannot be described,
    the digest differs each time, so that no former result is taken.
    """
    makers = [maker for maker in makers_in(case) if not is_known(maker.__module__)]
    if not makers:
        return {}
    try:
        found = digest(makers)
    except NoDigest as error:
        found = f"unknown ({error}), {uuid4().hex}"
    return {"code of registered classes": found}


@contextmanager
def _log_file(folder: Path, append: bool) -> Iterator[None]:
    """Context in which log lines are written to run.log in the results folder."""
    with writing("output", folder, "a folder"):
        # lines through a link would end up elsewhere, and nobody reads a pipe
        remove_foreign(folder / "run.log")
        handler = LogFile(folder / "run.log", "a" if append else "w", encoding="utf-8")
    with logging_to(handler):
        try:
            yield
        except Exception:
            log.exception("the run stopped")
            raise
        except BaseException as error:
            log.warning("the run was stopped (%s)", type(error).__name__)
            raise


def finished_results(case: Case, faces: dict[str, str], folder: Path) -> Results | None:
    """Complete results of the same case and face files in a folder, if what the case leaves open is chosen as then.

    Where the case asks for other files than those that are there, and their fields are not needed for them, the files
    are written first.

    faces : digest of every face file by its path in the case.

    Raises InputError: another run is under way in the folder.
    FemsealError : a file could not be written.
    """
    try:
        results = open_results(folder)
        face_files = json.loads(results.dataset.attrs.get("face_files", "{}"))
        then = json.loads(results.dataset.attrs.get("chosen", "{}"))
    except (FemsealError, ValueError, TypeError, RecursionError):
        return None
    echo = case.echo()
    if _numbers(results.case) != _numbers(echo) or face_files != faces:
        return None
    prepared = prepare(case)
    same_choices = then == _chosen(case, prepared)
    if same_choices and results.case == echo:
        return results
    if not same_choices or _lacks(results.case["output"], echo["output"]):
        log.info("computed again: the results in %s lack fields, or are of other choices", folder)
        return None
    with alone_in(folder):
        results.dataset.attrs["case"] = json.dumps(echo, ensure_ascii=False)
        options = {key: value for key, value in case.output.files.items() if key != "fields_limit"}
        write_again(
            results, last_version(case, prepared, results.attempts).scene.surface, **options
        )
        log.info("other files written to %s", folder)
    return results


def refuse_finished(folder: Path, case: Case | None = None) -> None:
    """Raise InputError where a folder holds the results of a finished run, or of one of another case.

    case : that may go on there; None: no results may be there.
    """
    path = folder / FILE_NAME
    if path.is_symlink() or not path.is_file():  # the file that a link leads to stays
        return
    if case is None:
        given = f"'{folder}', which holds the results of a finished run"
        expected = "another folder, --resume to take these results if they are of this case"
    else:
        try:
            former = open_results(folder).case
        except FemsealError:  # a damaged file is no result
            return
        if _numbers(former) == _numbers(case.echo()):  # computed again, as of another face file
            return
        given = f"'{folder}', which holds the results of another case, or of another version"
        expected = "another folder"
    expected += (
        ", or --replace (Python: replace_results=True) to compute this case and replace them"
    )
    raise InputError("output", given, expected)


def _chosen(case: Case, made: Prepared) -> dict[str, Any]:
    """What a run of a prepared case computes first, see `Prepared.chosen`, settings of an accuracy, and users' code."""
    if case.accuracy is None:
        return made.chosen | user_code(case)
    settings = asdict(first_settings(case, made))
    first = first_version(case, made).chosen | user_code(case)
    return first | {f"settings.{name}": value for name, value in settings.items()}


def _numbers(echo: dict[str, Any]) -> dict[str, Any]:
    """The case without what says only which files are written."""
    output = {key: value for key, value in echo.get("output", {}).items() if key not in FILE_KEYS}
    return {**echo, "output": output}


def _lacks(former: dict[str, Any], now: dict[str, Any]) -> bool:
    """Whether files are asked for that take fields of the studies which are not kept."""
    keys = ("fields", "fields_limit") if now["fields"] else ()
    others = any(former.get(key) != now[key] for key in keys)
    return others or now["paraview"] not in (former.get("paraview"), "none")
