"""Run the cases of a sweep one after the other, each into its own folder, and set them side by side."""

import logging
import os
import shutil
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from ..base import FemsealError, InputError, counted, made_folder
from ..case.case import read_case
from ..execution.parts import Part, checked_part, own_items
from ..execution.resuming import alone_in
from ..execution.run import no_progress
from ..preparation.preparation import prepare
from ..results.results import Results
from ..results.run_comparison import RunComparison, compared
from ..runs import job
from ..runs.forecast import refuse_too_large
from ..store.unfinished import refuse_unfinished
from .variations import short_names, variations, with_setting

log = logging.getLogger("femseal.sweeps")
#: Subfolder of the store that the cases share while the sweep is under way.
SHARED = ".shared"
#: Files of the table and the picture.
STEM = "sweep"


def sweep(
    case: str | os.PathLike[str],
    keys: Mapping[str, Sequence[Any]],
    output: str | os.PathLike[str],
    *,
    resume: bool = False,
    workers: int | None = None,
    scheduler: str | None = None,
    unit: str | None = None,
    part: Part | None = None,
    progress: job.Progress | None = None,
    announce: Callable[[str], None] | None = None,
) -> RunComparison:
    """Run a case with every combination of some values of its keys, and compare the leakages.

    Every case is checked before the first is run. What two cases have in common is computed once, such as the contact
    of a face that no key changes.

    Parameters
    ----------
    case : path of a case file.
    keys : values of dotted keys, such as {"material.hardness": ["3 GPa", "4 GPa"], "cells.count": [[4, 8], [8, 16]]};
        quantities are texts with their unit as in the file. "face.0.pitch" is a key of the first of two faces.
    output : folder, made if needed: a results folder for each case, `sweep.csv` and `sweep.png`.
    resume : take the cases that are complete, and go on with those that are not.
    workers, scheduler : of each run, see `run`. unit : of the comparison, see `compare`.
    part : such as (3, 16), to run the third sixteenth of the cases only, and write no table; with `resume` and without
        `part` the others are run that are not there, and all are compared.
    progress : called as progress(stage, done, total), also with the stage "cases". announce : called with a line for
        each case before it is run.

    Returns
    -------
    The runs side by side, of a part its own, without those that failed.

    Raises
    ------
    InputError : a key or a value cannot be used, or a folder cannot be written; nothing has been computed then.
    FemsealError : cases failed; the others are complete in their folders, and `resume` tries again those that are not.

    Examples
    --------
    >>> sweep("seal.toml", {"material.hardness": ["3 GPa", "4 GPa"]}, "results/hardness")  # doctest: +SKIP
    """
    data, base = read_case(case)
    cases = variations(data, base, keys)
    if part is not None:
        part, resume = checked_part(part), True
        first, end = own_items(part, count := len(cases))
        if not (cases := cases[first:end]):
            raise InputError(
                "part",
                f"{part[0]}/{part[1]} of {counted(count, 'case')}",
                "no more parts than cases",
            )
    folder = Path(output)
    if folder.exists() and not folder.is_dir():
        raise InputError(
            "output", f"'{folder}', which is a file", "a folder, or one that does not exist"
        )
    report = progress or no_progress
    for variation in cases:
        try:
            refuse_too_large(variation.case, prepare(variation.case))
        except InputError as error:
            raise with_setting(error, variation.setting) from error
        if not resume:
            refuse_unfinished(folder / variation.name)
    if not resume:
        refuse_unfinished(folder, SHARED)
    with alone_in(made_folder(folder), part):
        kept: dict[int, Results] = {}
        failures: list[str] = []
        report("cases", 0, len(cases))
        for n, variation in enumerate(cases):
            if announce is not None:
                announce(f"case {n + 1} of {len(cases)}: {variation.setting}")
            try:
                kept[n] = job.run(
                    variation.case,
                    folder / variation.name,
                    resume,
                    workers,
                    scheduler,
                    shared=folder / SHARED,
                    progress=report,
                )
            except InputError:
                raise
            except FemsealError as error:
                failures.append(f"{variation.name}: {error}")
                log.warning("%s", failures[-1])
            report("cases", n + 1, len(cases))
        if not kept:
            raise FemsealError(f"sweep: every case failed; the first: {failures[0]}")
        found = compared(
            [cases[n].name for n in kept],
            list(kept.values()),
            unit=unit,
            keys=short_names(list(keys)),
            settings=tuple(cases[n].values for n in kept),
        )
        if part is None:
            found.write(folder, STEM)
        if failures:
            lines = "\n".join(failures)
            text = f"sweep: {len(failures)} of {counted(len(cases), 'case')} failed; --resume tries them again\n{lines}"
            raise FemsealError(text)
        if part is None:
            shutil.rmtree(folder / SHARED, ignore_errors=True)
    return found
