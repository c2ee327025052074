"""Run a case: prepare it, solve its studies and write the results folder, or reuse complete results."""

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
from ..refinement.refine_to_accuracy import RefinedAnswer, refine_to_accuracy
from ..refinement.settings import first_settings, first_version, last_version
from ..report import write_again, write_folder
from ..results import Results, RunFacts, assemble, open_results
from ..results.dataset_file import FILE_NAME
from ..store.digests import is_known
from ..store.store import Store
from ..studies import FluidState, OtherLeakage, drop_ratio
from ..studies.compiling import compile_ahead
from .case_description import describe_case, solids_text
from .forecast import refuse_too_large

log = logging.getLogger("femseal")


#: Advice for users of the removed argument `part`, with which a run was divided among machines.
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
    """Run a case: compute contact, flow and leakage of its surface and its seal, and write the results.

    Parameters
    ----------
    case : Case or path
        The case, or the path of its file.
    output : path, optional
        Results folder, which is created if needed. By default, no files are written.
    resume : bool
        Whether to use results that are already in the folder. A stopped run is continued; its final results are bitwise
        identical to those of an uninterrupted run. If the folder holds a finished run of the same case, and the program
        would choose the same settings again, its results are returned.
    workers : int, optional
        Number of processes; by default one process for each core. The results do not depend on the number of processes.
    scheduler : str, optional
        Address of a Dask scheduler whose workers compute the results in place of local processes. Dask requires
        femseal[cluster]. The text "local" starts a temporary scheduler with `workers` processes, see
        `execution.run.ordered_map`.
    shared : path, optional
        Folder shared by several runs, for the results of single stages. A run stores the result of each stage in the
        shared folder. If the result for the same input is already there, it is read instead of computed. The shared
        folder grows with every run, because nothing is deleted from it.
    replace_results : bool
        Whether to replace the results of a finished run in the folder.
    progress : callable, optional
        Called as progress(stage, done, total) while states and realisations are computed.

    Returns
    -------
    Results

    Raises
    ------
    InputError
        Nothing has been written, for one of these reasons:

        - The case or an argument is invalid.
        - The run is expected to need more memory than is available.
        - Another run is under way in the folder.
        - The folder contains the results of a finished run, and `resume` is False.
        - The folder contains the results of a finished run of another case, and `resume` is True.
        - The folder contains an unfinished run, and `resume` is False.
        - The folder contains an unfinished run that differs in its case, its face files or its package versions.
    FemsealError
        The computation failed as a whole, or a file could not be written. The results of the completed stages stay in
        the folder; a run with `resume` continues from there. Single cells that fail raise no error: they are listed in
        `Results.failures`.

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
    identity = _identity(case, faces)
    if resume and folder is not None:
        finished = finished_results(case, faces, folder)
        if finished is not None:
            _remove_own_store(folder, identity)
            return finished
    if folder is not None and not replace_results:
        refuse_finished(folder, case if resume else None)
    progress = progress or no_progress

    with ExitStack() as stack:
        enter = stack.enter_context
        enter(storing(folder, case.memory))
        enter(reporting_compilation(progress))
        is_resumed: bool | None = None  # known as soon as the folder exists and is locked
        if folder is not None and folder.is_dir():
            is_resumed = enter(writing_in(folder, identity, resume))
        prepared = prepare(case)
        if scheduler is None:
            refuse_too_large(case, prepared)
        mapper = enter(ordered_map(workers, scheduler, partial(compile_ahead, progress=progress)))
        if folder is None:
            stage_folder = enter(TemporaryDirectory()) if shared is None else shared
            store = enter(Store(Path(stage_folder), required=False))
            return _results(case, prepared, faces, Run(store.over(mapper), progress))
        if is_resumed is None:
            # a new folder is made only now that the case is known to be valid
            is_resumed = enter(writing_in(made_folder(folder), identity, resume))
        enter(_log_file(folder, append=is_resumed))
        if is_resumed:
            log.info("resumed from %s", store_folder(folder))
        begin_run(folder, identity)
        store = enter(Store(Path(shared or store_folder(folder))))
        results = _results(case, prepared, faces, Run(store.over(mapper), progress))
        progress("writing results", 0, None)
        # the pictures are always drawn on this machine, also if a Dask scheduler computes the rest
        _write(results, folder, case, mapper if scheduler is None else map)
        for text in results.left_out:
            log.info("left out: %s", text)
        log.info("results in %s", folder)
        return replace(results, folder=folder)


def _identity(case: Case, faces: dict[str, str]) -> dict[str, Any]:
    """Return all data on which the results of a run depend, as nested dictionaries of plain values.

    Of the table [output], only the test fluid is included: all other keys in it may be changed before a run is resumed.
    """
    echo = case.echo()
    echo |= {"output": {"test_fluid": echo["output"].get("test_fluid")}}
    identity = echo | {"content of face files": faces, "version": numerical_versions()}
    return identity | user_code(case)


def _remove_own_store(folder: Path, identity: dict[str, Any]) -> None:
    """Remove the stored stages of a finished run from its folder, unless they belong to another run.

    identity : data that determine the results of the finished run, see `_identity`.
    """
    with suppress(InputError), alone_in(folder):
        resumable(folder, identity)  # raises InputError for another identity
        remove_run(folder)


def checked_output(output: AnyPath | None, resume: bool) -> Path | None:
    """Return the output folder as a path, or None if the run writes no files.

    Raises
    ------
    InputError
        The output is a file, or a run is to be resumed but no folder is given.
    """
    folder = None if output is None else Path(output)
    if folder is not None and folder.exists() and not folder.is_dir():
        expected = "a folder, or one that does not exist"
        raise InputError("output", f"'{folder}', which is a file", expected)
    if resume and folder is None:
        raise InputError("resume", resume, "an output folder with the run that is to be resumed")
    return folder


@contextmanager
def _interrupts() -> Iterator[None]:
    """Convert the SystemError that Numba raises on Ctrl-C in compiled code back to a KeyboardInterrupt."""
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
def _results(case: Case, original: Prepared, faces: dict[str, str], run: Run) -> Results:
    """Solve the studies of a case, its test fluid and its error budget, and assemble the results.

    Parameters
    ----------
    case : Case
        The case.
    original : Prepared
        The prepared case on the grid given in the case. The run may refine this grid to reach the required accuracy.
    faces : dict of str
        SHA-256 digest of each input file, by the path of the file, see `face_files`.
    run : Run
        Run that computes the stages.
    """
    log.info("case %s: surface %s", case.title or "without title", original.scene.surface)
    form_effect = original.solve_form_effect()
    prepared = original
    refined: RefinedAnswer | None = None
    studies: dict[str, Any] = {}
    if case.accuracy is not None:
        refined = refine_to_accuracy(case, original, run)
        prepared = refined.prepared
        studies[prepared.answer.key] = refined.result
    _solve_other_studies(prepared, studies, run)
    answer = studies[prepared.answer.key]
    warnings = prepared.warnings
    if form_effect is not None:
        warnings += tuple(form_effect.warnings)
    test = None
    if case.output.test_fluid is not None:
        state = case.output.test_fluid.state
        test = _solve_test_fluid(state, prepared, answer, run)
        tested_scene = state.in_scene(prepared.scene)
        texts = flow_warnings(tested_scene, test.leakage, answer.surface_gap)
        warnings += tuple(f"Test fluid: {text}" for text in texts)
    budgets: dict[str, ErrorBudget] = {}
    # the budget comes last, so that it can be switched on or off before a run is resumed
    if case.output.budget:
        known_budgets = {} if refined is None else {prepared.answer.key: refined.budget}
        request = BudgetRequest(
            prepared,
            case.output.model_parts,
            case.hardness_tolerance,
            hardness_over_yield=case.hardness_over_yield,
            form_effect=form_effect,
        )
        with run.timed("error budget") as mapper:
            budgets = budgets_of(request, studies, mapper, known_budgets)
    description = [*describe_case(case, prepared, answer.quick_estimate, form_effect)]
    attributes = {
        "seat": prepared.seat,
        "face_files": json.dumps(faces),
        "timed_parts": json.dumps(run.parts),
        "solids": solids_text(case),
        "description": json.dumps(description, ensure_ascii=False),
        "chosen": json.dumps(_settings(case, original)),
    }
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


def _solve_other_studies(prepared: Prepared, studies: dict[str, Any], run: Run) -> None:
    """Solve the studies of a prepared case that are missing from `studies`, and add each result under its key."""
    for study in prepared.solved_studies:
        if study.key not in studies:
            with run.timed(study.name) as mapper:
                studies[study.key] = prepared.solve(study, mapper)
    for study in prepared.studies:
        if study.contained in prepared.studies:
            studies[study.contained.key] = study.contained_result(studies[study.key])


def _solve_test_fluid(state: FluidState, prepared: Prepared, answer: Any, run: Run) -> OtherLeakage:
    """Compute the leakage of the test fluid through the same seals, by the best method of the run.

    If both fluids see the same permeability, the leakage of the service fluid is scaled by the ratio of the two
    potential drops. If the permeability depends on the fluid, the best method is run again with the test fluid.

    answer : result of the best method for the service fluid.
    """
    ratio = drop_ratio(state, prepared.scene)
    if ratio is not None:
        return OtherLeakage.of_study(state, answer, ratio)
    same_seals = prepared
    if answer.realisation_count is not None:
        same_seals = prepared.with_realisations(answer.realisation_count)
    tested = replace(same_seals, scene=state.in_scene(prepared.scene))
    with run.timed("test fluid") as mapper:
        return OtherLeakage.of_study(state, tested.solve(tested.answer, mapper))


def _write(results: Results, folder: Path, case: Case, mapper: Mapper) -> None:
    """Write the results into the folder, and then remove the stored stages of the run."""
    try:
        surface = None if results.scene is None else results.scene.surface
        write_folder(results, folder, surface, mapper=mapper, **case.output.files)
    except Exception as error:
        is_explained = isinstance(error, FemsealError)
        reason = str(error) if is_explained else f"results: {error or type(error).__name__}"
        text = f"{reason}; fix that, and run again with --resume, which only writes the files"
        raise FemsealError(text) from error
    remove_run(folder)


def face_files(case: Case) -> dict[str, str]:
    """Return the SHA-256 digest of every file that a case reads, by the path of the file in the case.

    These are the height maps and masks of the faces, the files named for the seal and the seat, and pressure maps.
    """
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
    """Distinguish runs whose case contains user-defined classes: fluids, seal shapes, seats and forms.

    The dictionary is empty if the case contains no user-defined classes. Otherwise, its value differs in each call, so
    that no earlier result is reused: the code of such a class may have changed.
    """
    if all(is_known(maker.__module__) for maker in makers_in(case)):
        return {}
    return {"code of registered classes": uuid4().hex}


@contextmanager
def _log_file(folder: Path, append: bool) -> Iterator[None]:
    """Write log lines to run.log in the results folder inside the `with` block."""
    with writing("output", folder, "a folder"):
        # if run.log were a link, the lines would go to another file; if it were a pipe, writing would block
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
    """Read the results of a finished run from a folder, if running the case now would give the same results.

    If the case requests pictures or tables that are not yet in the folder, they are written first.

    Parameters
    ----------
    case : Case
        The case.
    faces : dict of str
        SHA-256 digest of each input file, by the path of the file, see `face_files`.
    folder : Path
        Results folder.

    Returns
    -------
    Results or None
        None if the folder contains no results, or if the case, a face file or the settings are different. None is also
        returned if the case requests files with fields over all pixels, which cannot be written from the results.

    Raises
    ------
    InputError
        Another run is under way in the folder.
    FemsealError
        A file could not be written.
    """
    try:
        results = open_results(folder)
        former_faces = json.loads(results.dataset.attrs.get("face_files", "{}"))
        former_settings = json.loads(results.dataset.attrs.get("chosen", "{}"))
    except (FemsealError, ValueError, TypeError, RecursionError):
        return None
    echo = case.echo()
    # results of another case, or from other input files
    if _without_file_keys(results.case) != _without_file_keys(echo) or former_faces != faces:
        return None
    # the settings that the program chooses may have changed with its version or with the code of the user
    prepared = prepare(case)
    has_same_settings = former_settings == _settings(case, prepared)
    if has_same_settings and results.case == echo:
        return results
    if not has_same_settings or _needs_new_fields(results.case["output"], echo["output"]):
        log.info("the results in %s lack fields, or have other settings: they are replaced", folder)
        return None
    # only the files differ: write them from the results
    with alone_in(folder):
        results.dataset.attrs["case"] = json.dumps(echo, ensure_ascii=False)
        options = {key: value for key, value in case.output.files.items() if key != "fields_limit"}
        surface = last_version(case, prepared, results.attempts).scene.surface
        write_again(results, surface, **options)
        log.info("other files written to %s", folder)
    return results


def refuse_finished(folder: Path, case: Case | None = None) -> None:
    """Raise InputError if a folder contains results of a finished run that must not be replaced.

    Parameters
    ----------
    folder : Path
        Results folder.
    case : Case, optional
        Case of a resumed run, whose earlier results may be replaced. By default, no earlier results may be replaced.
    """
    path = folder / FILE_NAME
    if path.is_symlink() or not path.is_file():
        # writing the results would replace a link, but not the file to which it leads
        return
    if case is None:
        given = f"'{folder}', which holds the results of a finished run"
        expected = "another folder, --resume to take these results if they are of this case"
    else:
        try:
            former = open_results(folder).case
        except FemsealError:  # a damaged file contains no results to be lost
            return
        if _without_file_keys(former) == _without_file_keys(case.echo()):
            # the same case is computed again, for example because a face file has changed
            return
        given = f"'{folder}', which holds the results of another case, or of another version"
        expected = "another folder"
    expected += (
        ", or --replace (Python: replace_results=True) to compute this case and replace them"
    )
    raise InputError("output", given, expected)


def _settings(case: Case, original: Prepared) -> dict[str, Any]:
    """Return the settings that the program chooses for a case, and an entry for user-defined classes.

    If the case requests an accuracy, the settings of the first attempt are returned.
    """
    if case.accuracy is None:
        return original.chosen | user_code(case)
    chosen = first_version(case, original).chosen | user_code(case)
    settings = asdict(first_settings(case, original))
    return chosen | {f"settings.{name}": value for name, value in settings.items()}


def _without_file_keys(echo: dict[str, Any]) -> dict[str, Any]:
    """Return a copy of a case without the keys that only control which files are written."""
    output = {key: value for key, value in echo.get("output", {}).items() if key not in FILE_KEYS}
    return {**echo, "output": output}


def _needs_new_fields(former_output: dict[str, Any], output: dict[str, Any]) -> bool:
    """Return whether the case requests files that cannot be written from the results of a former run.

    Files with fields over all pixels and files for ParaView cannot be written from the results.

    former_output : table [output] of the former run's case.
    output : table [output] of the present case.
    """
    if output["paraview"] not in (former_output.get("paraview"), "none"):
        return True
    if not output["fields"]:
        return False
    return any(former_output.get(key) != output[key] for key in ("fields", "fields_limit"))
