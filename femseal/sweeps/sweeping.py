"""Run a case with every combination of given values of some keys, and compare the runs."""

from __future__ import annotations

import copy
import logging
import re
import shutil
import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from math import prod
from pathlib import Path
from typing import Any

from ..base import (
    AnyPath,
    FemsealError,
    InputError,
    InputErrors,
    counted,
    made_folder,
    shortened,
    shown,
    validate,
)
from ..case.case import Case
from ..case.output_table import with_picture_formats
from ..case.reading import parse_case, read_case
from ..execution.resuming import alone_in, refuse_unfinished
from ..execution.run import no_progress
from ..preparation.preparation import prepare
from ..results.results import Results
from ..results.run_comparison import RunComparison, compared
from ..runs import job
from ..runs.finished_run import refuse_finished
from ..runs.forecast import refuse_too_large

log = logging.getLogger("femseal.sweeps")
#: Subfolder for the results of stages, which all cases share while the sweep is running.
SHARED = ".shared"
#: Name of the files of the table and the picture, without extension.
STEM = "sweep"
#: Largest number of cases of a sweep.
MOST_CASES = 1000
#: Longest name of the folder of a case, in characters.
_LONGEST_NAME = 100


@dataclass(frozen=True)
class Variation:
    """Describe a case of a sweep.

    Parameters
    ----------
    name : str
        Name of the results folder of the case.
    setting : str
        Text with the changed keys and their values, for tables and messages.
    values : tuple of str
        Values of the changed keys as strings.
    case : Case
        Case in which the keys have the changed values.
    """

    name: str
    setting: str
    values: tuple[str, ...]
    case: Case


@validate.removed_arguments(part=job.DIVIDED_BY_DASK)
def sweep(
    case: AnyPath,
    keys: Mapping[str, Sequence[Any]],
    output: AnyPath,
    *,
    resume: bool = False,
    replace_results: bool = False,
    workers: int | None = None,
    scheduler: str | None = None,
    unit: str | None = None,
    formats: Sequence[str] = (),
    progress: job.Progress | None = None,
    announce: Callable[[str], None] | None = None,
) -> RunComparison:
    """Run a case with every combination of given values of some keys, and compare the leakages.

    All cases are checked before the first case is run. If a stage of the computation has the same input in several
    cases, the stage is computed only once. For example, if the cases differ only in the fluid, the contact of the
    surface is solved only once.

    Parameters
    ----------
    case : path
        Case file.
    keys : mapping of sequences
        Values of dotted keys, such as {"material.hardness": ["3 GPa", "4 GPa"], "cells.count": [[4, 8], [8, 16]]}.
        A quantity is given as a string with a unit, as in the case file. A number in a key is the index, from 0, of a
        table among the tables of the same name: the key "face.0.pitch" is the pitch of the first face.
    output : path
        Folder for `sweep.csv`, `sweep.png` and the results folders of the cases; created if it does not exist.
    resume : bool
        Whether to use the results of complete cases of an earlier sweep in this folder, and to continue its unfinished
        cases.
    replace_results : bool
        Whether to replace the results of finished runs in the folders of the cases.
    workers, scheduler
        See `run`.
    unit : str, optional
        Leakage unit of the comparison, see `compare`.
    formats : sequence of {"png", "svg", "pdf"}
        Formats of all pictures; by default the formats that the case file states.
    progress : callable, optional
        Called as progress(stage, done, total). For the stage "cases", `done` is the number of complete cases.
    announce : callable, optional
        Called with a line of text before each case is run.

    Returns
    -------
    RunComparison
        Comparison of all runs that did not fail.

    Raises
    ------
    InputError
        A key or a value cannot be used, or a folder cannot be written. The error is raised before the first case is
        run.
    FemsealError
        At least one case failed. The results of all successful cases are in their folders. A further call with `resume`
        runs the failed cases again.

    Examples
    --------
    >>> sweep("seal.toml", {"material.hardness": ["3 GPa", "4 GPa"]}, "results/hardness")  # doctest: +SKIP
    """
    cases = variations(*read_case(case), keys)
    if formats:
        cases = [replace(one, case=with_picture_formats(one.case, tuple(formats))) for one in cases]
    folder = job.checked_output(output, resume)
    assert folder is not None
    report_progress = progress or no_progress
    for variation in cases:
        _check_before_run(variation, folder, resume, replace_results)
    if not resume:
        refuse_unfinished(folder, SHARED)
    finished: list[tuple[Variation, Results]] = []
    failures: list[str] = []
    with alone_in(made_folder(folder)):
        report_progress("cases", 0, len(cases))
        for number, variation in enumerate(cases, start=1):
            if announce is not None:
                announce(f"case {number} of {len(cases)}: {variation.setting}")
            try:
                results = job.run(
                    variation.case,
                    folder / variation.name,
                    resume,
                    workers,
                    scheduler,
                    shared=folder / SHARED,
                    replace_results=replace_results,
                    progress=report_progress,
                )
                finished.append((variation, results))
            except InputError:
                raise
            except FemsealError as error:
                failures.append(f"{variation.name}: {error}")
                log.warning("%s", failures[-1])
            report_progress("cases", number, len(cases))
        if not finished:
            raise FemsealError(f"sweep: every case failed; error of the first case: {failures[0]}")
        comparison = compared(
            [variation.name for variation, _ in finished],
            tuple(results for _, results in finished),
            unit=unit,
            keys=short_names(list(keys)),
            settings=tuple(variation.values for variation, _ in finished),
        )
        comparison.write(folder, STEM, cases[0].case.output.picture_formats)
        if failures:
            n_cases = counted(len(cases), "case")
            summary = f"sweep: {len(failures)} of {n_cases} failed; --resume tries them again"
            raise FemsealError("\n".join([summary, *failures]))
        shutil.rmtree(folder / SHARED, ignore_errors=True)
    return comparison


def _check_before_run(
    variation: Variation, folder: Path, resume: bool, replace_results: bool
) -> None:
    """Raise InputError if a case is too large for the machine, or if its folder contains results.

    Earlier results are allowed if they may be replaced, or if they belong to the same case and the sweep is resumed.
    """
    try:
        refuse_too_large(variation.case, prepare(variation.case))
    except InputError as error:
        raise with_setting(error, variation.setting) from error
    if not resume:
        refuse_unfinished(folder / variation.name)
    if not replace_results:
        refuse_finished(folder / variation.name, variation.case if resume else None)


# --- the cases --------------------------------------------------------------------------------------------


def parsed_keys(arguments: Sequence[str]) -> dict[str, list[Any]]:
    """Parse strings that assign values to keys, such as "material.hardness=3GPa,4GPa".

    Values are written as in TOML, but a string outside of a list needs no quotes: 3GPa means "3GPa".

    Parameters
    ----------
    arguments : sequence of str
        One text for each key, which contains the key and its values.

    Returns
    -------
    dict of lists
        Mapping from each key to the list of its values.

    Raises
    ------
    InputError
        A string has no "=", a key has no values, or a key is given twice.

    Examples
    --------
    >>> parsed_keys(["cells.count=[4, 8],[8,16]", "seed=1,2", "material.hardness=3 GPa"])
    {'cells.count': [[4, 8], [8, 16]], 'seed': [1, 2], 'material.hardness': ['3 GPa']}
    """
    values_by_key: dict[str, list[Any]] = {}
    for text in arguments:
        left, sign, values = text.partition("=")
        key = left.strip()
        if not sign or not key or not values.strip():
            expected = "a key of the case and its values, such as seed=1,2,3"
            raise InputError("sweep", shown(text), expected)
        if key in values_by_key:
            raise InputError(
                "sweep",
                f"the key {key} twice",
                "a single argument for this key, with all its values",
            )
        values_by_key[key] = _parse_values(values)
    return values_by_key


def _parse_values(text: str) -> list[Any]:
    """Parse values that are separated by commas. Each is a TOML value, or a string without quotes."""
    try:
        return list(tomllib.loads(f"values = [{text}]")["values"])
    except (tomllib.TOMLDecodeError, RecursionError):
        # at least one value is a text without quotes: parse the values one by one
        parts = [part.strip() for part in text.split(",")]
    if len(parts) == 1:
        return parts
    values = []
    for part in parts:
        values += _parse_values(part)
    return values


def variations(
    data: dict[str, Any], folder: Path, keys: Mapping[str, Sequence[Any]]
) -> list[Variation]:
    """Make and check a case for each combination of the values. The value of the last key changes fastest.

    Parameters
    ----------
    data : dict
        Content of the case file: its tables, by their names.
    folder : Path
        Folder of the case file, to which the paths in the case are relative.
    keys : mapping of sequences
        Values of dotted keys, see `sweep`.

    Returns
    -------
    list of Variation

    Raises
    ------
    InputError
        No key is given, a key does not exist, a key has no values or has the same value twice, there are more than
        `MOST_CASES` combinations, or a case is not valid. The message contains a line for each fault.
    """
    _check_values(keys)
    short_keys = short_names(list(keys))
    cases: list[Variation] = []
    faults: list[InputError] = []
    for values in product(*keys.values()):
        texts = tuple(value_text(value) for value in values)
        pairs = list(zip(short_keys, texts, strict=True))
        setting = ", ".join(f"{key} = {text}" for key, text in pairs)
        changed_data = copy.deepcopy(data)
        for key, value in zip(keys, values, strict=True):
            _set_key(changed_data, key, copy.deepcopy(value))
        try:
            case = parse_case(changed_data, folder)
        except InputError as error:
            single_faults = getattr(error, "faults", (error,))
            faults += [with_setting(fault, setting) for fault in single_faults]
            continue
        cases.append(Variation(_folder_name(pairs), setting, texts, case))
    if faults:
        raise InputErrors(faults)
    return _with_usable_names(cases)


def _check_values(keys: Mapping[str, Sequence[Any]]) -> None:
    """Raise InputError if the values of a sweep cannot be used, or if there are too many cases."""
    if not keys:
        expected = "at least one key of the case with its values, such as seed=1,2,3"
        raise InputError("sweep", "no key", expected)
    for key, values in keys.items():
        if isinstance(values, (str, bytes)) or not isinstance(values, Sequence) or not len(values):
            raise InputError(f"sweep: {shortened(key)}", shown(values), "a list of values")
        texts = [value_text(value) for value in values]
        if len(set(texts)) < len(texts):
            raise InputError(f"sweep: {shortened(key)}", shown(values), "values that differ")
    n_cases = prod(len(values) for values in keys.values())
    if n_cases > MOST_CASES:
        raise InputError("sweep", f"{n_cases} cases", f"at most {MOST_CASES}")


def _folder_name(pairs: list[tuple[str, str]]) -> str:
    """Make a folder name from keys and values. Hyphens replace characters that some file systems do not allow."""
    name = "_".join(f"{key}={text}" for key, text in pairs).replace(" ", "")
    return re.sub(r"[^\w.=+-]+", "-", name).strip("-.")


def _with_usable_names(cases: list[Variation]) -> list[Variation]:
    """Name the cases by numbers if their names are too long, or if two names differ only in upper and lower case."""
    names = {variation.name.lower() for variation in cases}
    if len(names) == len(cases) and max(len(name) for name in names) <= _LONGEST_NAME:
        return cases
    return [replace(variation, name=f"case-{n}") for n, variation in enumerate(cases, 1)]


def with_setting(error: InputError, setting: str) -> InputError:
    """Append the changed keys and values of a case to the message of an error."""
    return InputError(error.what, error.given, f"{error.expected} (with {shortened(setting)})")


def short_names(keys: Sequence[str]) -> tuple[str, ...]:
    """Shorten dotted keys, in whole parts, to the shortest endings that still tell them apart.

    Examples
    --------
    >>> short_names(["material.young", "counter_material.young", "stochastic.length"])
    ('material.young', 'counter_material.young', 'length')
    """

    def shorten(key: str) -> str:
        """Return the shortest ending of a key, in whole parts, that no other key shares."""
        parts = key.split(".")
        for count in range(1, len(parts) + 1):
            ending = ".".join(parts[-count:])
            # with a dot in front, an ending only matches whole parts
            n_matching = sum(f".{other}".endswith(f".{ending}") for other in keys)
            if n_matching == 1:
                return ending
        return key

    return tuple(shorten(key) for key in keys)


def value_text(value: Any) -> str:
    """Format a value of a key as a short string.

    Examples
    --------
    >>> value_text([8, 16]), value_text("3 GPa"), value_text(True), value_text({"angle": "30 deg"})
    ('[8, 16]', '3 GPa', 'true', '{angle = 30 deg}')
    """
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, (list, tuple)):
        items = ", ".join(value_text(item) for item in value)
        return f"[{items}]"
    if isinstance(value, Mapping):
        items = ", ".join(f"{key} = {value_text(item)}" for key, item in value.items())
        return f"{{{items}}}"
    return str(value)


def _set_key(data: dict[str, Any], key: str, value: Any) -> None:
    """Set the value of a dotted key in nested tables and lists. Tables that do not exist are created."""
    parts = key.split(".")
    table: Any = data  # table or list to which the next part of the key belongs
    for n, part in enumerate(parts):
        index: Any = part  # name in a table, or number in a list
        if isinstance(table, list):
            if not part.isdecimal() or int(part) >= len(table):
                list_name = ".".join(parts[:n])
                expected = f"the number of one of the {len(table)} tables '{list_name}', from 0"
                raise InputError(f"sweep: {shortened(key)}", shown(part), expected)
            index = int(part)
        elif not isinstance(table, dict) or not part:
            expected = "a dotted key of the case, such as material.hardness"
            raise InputError("sweep", shown(key), expected)
        if n + 1 == len(parts):
            table[index] = value
            return
        if isinstance(table, dict):
            table.setdefault(part, {})
        table = table[index]
