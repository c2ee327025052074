"""Run a case: prepare it, solve its studies and write the results folder, or reuse complete results."""

from __future__ import annotations

import logging
import math
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

from ..base import AnyPath, FemsealError, InputError, Mapper, made_folder, validate, writing
from ..base.files import remove_foreign
from ..base.shared_arrays import storing
from ..case.case import Case
from ..case.reading import load_case
from ..execution.resuming import begin_run, remove_run, store_folder, writing_in
from ..execution.run import (
    LogFile,
    Progress,
    Run,
    logging_to,
    no_progress,
    ordered_map,
    reporting_compilation,
)
from ..preparation.preparation import prepare
from ..report import write_folder
from ..results import Results
from ..store.store import Store
from ..studies.compiling import compile_ahead
from .finished_run import finished_results, refuse_finished, remove_stored_stages
from .forecast import refuse_too_large
from .identity import face_files, run_identity, user_code
from .solving import solve_case

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
    identity = run_identity(case, faces)
    if resume and folder is not None:
        finished = finished_results(case, faces, folder)
        if finished is not None:
            remove_stored_stages(folder, identity)
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
        study_input = prepare(case)
        if scheduler is None:
            refuse_too_large(case, study_input)
        studies_use_mirrors = any(study.uses_mirrors for study in study_input.studies)
        has_mirrors = "mirror" in study_input.scene.boundary or studies_use_mirrors
        compile_first = partial(
            compile_ahead,
            progress=progress,
            has_mirrors=has_mirrors,
            largest_grid=math.prod(study_input.scene.surface.shape),
        )
        mapper = enter(ordered_map(workers, scheduler, compile_first))
        if folder is None:
            stage_folder = enter(TemporaryDirectory()) if shared is None else shared
            store = enter(Store(Path(stage_folder), required=False))
            return solve_case(case, study_input, faces, Run(store.over(mapper), progress))
        if is_resumed is None:
            # a new folder is made only now that the case is known to be valid
            is_resumed = enter(writing_in(made_folder(folder), identity, resume))
        enter(_log_file(folder, append=is_resumed))
        if is_resumed:
            log.info("resumed from %s", store_folder(folder))
        begin_run(folder, identity)
        store = enter(Store(Path(shared or store_folder(folder))))
        results = solve_case(case, study_input, faces, Run(store.over(mapper), progress))
        progress("writing results", 0, None)
        # the pictures are always drawn on this machine, also if a Dask scheduler computes the rest
        _write(results, folder, case, mapper if scheduler is None else map)
        for text in results.left_out:
            log.info("left out: %s", text)
        log.info("results in %s", folder)
        return replace(results, folder=folder)


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


def _write(results: Results, folder: Path, case: Case, mapper: Mapper) -> None:
    """Write the results into the folder, and then remove the stored stages of the run."""
    try:
        surface = None if results.scene is None else results.scene.surface
        write_folder(results, folder, surface, mapper=mapper, **case.output.files)
    except Exception as error:
        is_explained = isinstance(error, FemsealError)
        reason = str(error) if is_explained else f"results: {error or type(error).__name__}"
        can_resume = not user_code(case)
        resume = " with --resume, which only writes the files" if can_resume else ""
        text = f"{reason}; fix that, and run again{resume}"
        raise FemsealError(text) from error
    remove_run(folder)
