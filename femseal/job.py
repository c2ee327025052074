"""One run of a case: prepare, compute each study, write the results folder."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterable, Iterator, Sized
from contextlib import contextmanager
from dataclasses import replace
from os import PathLike
from pathlib import Path
from typing import Any

from .case import Case, Prepared, load_case
from .errors import FemsealError, InputError
from .output import Results, assemble, write_folder
from .parallel import Map, ordered_map
from .studies import deterministic, stochastic, two_scale

log = logging.getLogger("femseal")
#: Called as progress(stage, done, total); total is None where it is not known.
Progress = Callable[[str, int, int | None], None]


def run(
    case: Case | str | PathLike[str],
    output: str | PathLike[str] | None = None,
    resume: bool = False,
    workers: int | None = None,
    scheduler: str | None = None,
    *,
    progress: Progress | None = None,
) -> Results:
    """Run a case from surface to leakage.

    Parameters
    ----------
    case : a `Case`, or the path of a case file.
    output : results folder, made if it does not exist; None writes nothing.
    resume : take the results from the folder if it holds those of the same case, complete.
    workers : processes; all cores unless given. The results do not depend on it.
    scheduler : address of a Dask scheduler to compute on instead (femseal[cluster]).
    progress : called as progress(stage, done, total) while windows and realisations are computed.

    Raises
    ------
    InputError : the case or an argument cannot be used; nothing has been written then.
    FemsealError : a computation failed as a whole, or a file could not be written: `write_folder` says where the
        results are then. Single cells that fail are listed in `Results.warnings`.
    """
    if not isinstance(case, Case):
        case = load_case(case)
    if workers is not None and (not isinstance(workers, int) or workers < 1):
        raise InputError.of("workers", workers, "a whole number >= 1, or None for all cores")
    folder = None if output is None else Path(output)
    if folder is not None and folder.exists() and not folder.is_dir():
        raise InputError.of("output", f"'{folder}', which is a file", "a folder, or one that does not exist")
    if resume:
        if folder is None:
            raise InputError.of("resume", True, "True only with an output folder")
        if (finished := _finished(case, folder)) is not None:
            return finished
    prepared = case.prepare()
    with ordered_map(workers, scheduler) as mapper, _log_file(folder):
        return _run(case, prepared, folder, mapper, progress or (lambda stage, done, total: None))


def _run(case: Case, prepared: Prepared, folder: Path | None, mapper: Map, progress: Progress) -> Results:
    scene, cells = prepared.scene, prepared.cells
    log.info("case %s: surface %s", case.title or "without title", scene.surface)
    timings: dict[str, float] = {}
    studies: dict[str, Any] = {}
    # the cheapest route that the comparison needs comes first, the answer last
    for method in ("deterministic", "two-scale", "stochastic"):
        if method not in case.methods:
            continue
        start = time.perf_counter()
        watched = _watched(mapper, method, progress)
        if method == "deterministic":
            studies["deterministic"] = deterministic(scene, map=watched)
        elif method == "two-scale":
            assert cells is not None
            studies["two_scale"] = two_scale(scene, cells, map=watched)
        else:
            assert cells is not None
            assert prepared.sampling is not None
            studies["stochastic"] = stochastic(scene, cells, prepared.sampling, map=watched)
        timings[method] = time.perf_counter() - start
        log.info("%s: %.1f s", method, timings[method])
    results = assemble(
        scene,
        **studies,
        case=case.echo(),
        surface_report=prepared.surface_report,
        timings=timings,
        quantiles=case.stochastic.quantiles if case.stochastic else (0.05, 0.95),
    )
    for warning in results.warnings:
        log.warning("%s", warning)
    if folder is not None:
        progress("writing results", 0, None)
        write_folder(results, folder, scene.surface)
        results = replace(results, folder=folder)
        log.info("results in %s", folder)
    return results


def _finished(case: Case, folder: Path) -> Results | None:
    """Complete results of the same case in a folder."""
    from .output import open_results

    try:
        results = open_results(folder)
    except FemsealError:
        return None
    return results if results.case == case.echo() else None


@contextmanager
def _log_file(folder: Path | None) -> Iterator[None]:
    """Log lines go to run.log in the results folder."""
    if folder is None:
        yield
        return
    try:
        folder.mkdir(parents=True, exist_ok=True)
        handler = logging.FileHandler(folder / "run.log", mode="w", encoding="utf-8")
    except OSError as error:
        raise InputError.of("output", f"'{folder}'", f"a folder that can be written ({error.strerror})") from None
    handler.setFormatter(logging.Formatter("%(asctime)s %(levelname)s %(message)s"))
    level = log.level
    log.addHandler(handler)
    log.setLevel(logging.INFO)
    try:
        yield
    except Exception:
        log.exception("the run stopped")
        raise
    finally:
        log.removeHandler(handler)
        log.setLevel(level)
        handler.close()


def _watched(mapper: Map, stage: str, progress: Progress) -> Map:
    """The same map, telling how far it is."""

    def mapping(function: Callable[..., Any], *iterables: Iterable[Any]) -> Iterator[Any]:
        total = min((len(i) for i in iterables if isinstance(i, Sized)), default=None)
        name = getattr(getattr(function, "func", function), "__name__", "").strip("_").replace("_", " ")
        progress(f"{stage}: {name}", 0, total)
        for done, item in enumerate(mapper(function, *iterables), start=1):
            progress(f"{stage}: {name}", done, total)
            yield item

    return mapping
