"""A sweep: every combination of the values of some keys of a case, run one after the other and set side by side."""

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
from ..case.reading import parse_case, read_case
from ..execution.resuming import alone_in, refuse_unfinished
from ..execution.run import no_progress
from ..preparation.preparation import prepare
from ..results.results import Results
from ..results.run_comparison import RunComparison, compared
from ..runs import job
from ..runs.forecast import refuse_too_large

log = logging.getLogger("femseal.sweeps")
#: Subfolder of the store that the cases share while the sweep is under way.
SHARED = ".shared"
#: Files of the table and the picture.
STEM = "sweep"
#: No sweep has more cases.
MOST_CASES = 1000
#: Longest name of a folder, in characters.
_LONGEST_NAME = 100


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
    replace_results : compute cases whose folders hold results of finished runs, and replace these.
    workers, scheduler : of each run, see `run`. unit : of the comparison, see `compare`.
    progress : called as progress(stage, done, total), also with the stage "cases". announce : called with a line for
        each case before it is run.

    Returns
    -------
    The runs side by side, without those that failed.

    Raises
    ------
    InputError : a key or a value cannot be used, or a folder cannot be written; nothing has been computed then.
    FemsealError : cases failed; the others are complete in their folders, and `resume` tries again those that are not.

    Examples
    --------
    >>> sweep("seal.toml", {"material.hardness": ["3 GPa", "4 GPa"]}, "results/hardness")  # doctest: +SKIP
    """
    cases = variations(*read_case(case), keys)
    folder = job.checked_output(output, resume)
    assert folder is not None
    report = progress or no_progress
    for variation in cases:
        try:
            refuse_too_large(variation.case, prepare(variation.case))
        except InputError as error:
            raise with_setting(error, variation.setting) from error
        if not resume:
            refuse_unfinished(folder / variation.name)
        if not replace_results:
            job.refuse_finished(folder / variation.name, variation.case if resume else None)
    if not resume:
        refuse_unfinished(folder, SHARED)
    with alone_in(made_folder(folder)):
        kept: list[tuple[Variation, Results]] = []
        failures: list[str] = []
        report("cases", 0, len(cases))
        for n, variation in enumerate(cases):
            if announce is not None:
                announce(f"case {n + 1} of {len(cases)}: {variation.setting}")
            try:
                where = folder / variation.name, resume, workers, scheduler
                shared = folder / SHARED
                results = job.run(
                    variation.case,
                    *where,
                    shared=shared,
                    replace_results=replace_results,
                    progress=report,
                )
                kept.append((variation, results))
            except InputError:
                raise
            except FemsealError as error:
                failures.append(f"{variation.name}: {error}")
                log.warning("%s", failures[-1])
            report("cases", n + 1, len(cases))
        if not kept:
            raise FemsealError(f"sweep: every case failed; the first: {failures[0]}")
        done, runs = zip(*kept, strict=True)
        names, settings = [one.name for one in done], tuple(one.values for one in done)
        shorts = short_names(list(keys))
        found = compared(names, runs, unit=unit, keys=shorts, settings=settings)
        found.write(folder, STEM)
        if failures:
            text = f"sweep: {len(failures)} of {counted(len(cases), 'case')} failed; --resume tries them again"
            raise FemsealError("\n".join([text, *failures]))
        shutil.rmtree(folder / SHARED, ignore_errors=True)
    return found


@dataclass(frozen=True)
class Variation:
    """One case of a sweep.

    name : of its folder. setting : the keys with their values, as text. values : of the keys, as texts. case : the
    case with these values.
    """

    name: str
    setting: str
    values: tuple[str, ...]
    case: Case


def parsed_keys(arguments: Sequence[str]) -> dict[str, list[Any]]:
    """Values of the keys from texts such as "material.hardness=3GPa,4GPa".

    Values are those of TOML, where text in a list has quotes; other text needs none: 3GPa is "3GPa".

    Raises InputError: a text without "=", a key without values, or a key that is given twice.

    >>> parsed_keys(["cells.count=[4, 8],[8,16]", "seed=1,2", "material.hardness=3 GPa"])
    {'cells.count': [[4, 8], [8, 16]], 'seed': [1, 2], 'material.hardness': ['3 GPa']}
    """
    keys: dict[str, list[Any]] = {}
    for text in arguments:
        key, sign, values = text.partition("=")
        if not sign or not key.strip() or not values.strip():
            expected = "a key of the case and its values, such as seed=1,2,3"
            raise InputError("sweep", shown(text), expected)
        if (key := key.strip()) in keys:
            raise InputError("sweep", f"the key {key} twice", "each key once, with all its values")
        keys[key] = _values(values)
    return keys


def _values(text: str) -> list[Any]:
    """Values as a list of TOML, else texts at the commas, each of which may be a value."""
    try:
        return list(tomllib.loads(f"values = [{text}]")["values"])
    except (tomllib.TOMLDecodeError, RecursionError):
        parts = [part.strip() for part in text.split(",")]
    return parts if len(parts) == 1 else [value for part in parts for value in _values(part)]


def variations(
    data: dict[str, Any], folder: Path, keys: Mapping[str, Sequence[Any]]
) -> list[Variation]:
    """Every combination of the values, the first key slowest; all of them are checked.

    data : the tables of the case. folder : of the case file, to which its paths are relative.
    keys : values of dotted keys such as "material.hardness"; "face.0.pitch" is in the first of several faces.

    Raises InputError: no key, a key without values or with one value twice, a key that cannot be, more than
    `MOST_CASES` cases, or a case that cannot be used; one line for each fault.
    """
    if not keys:
        expected = "at least one key of the case with its values, such as seed=1,2,3"
        raise InputError("sweep", "no key", expected)
    for key, values in keys.items():
        if isinstance(values, (str, bytes)) or not isinstance(values, Sequence) or not len(values):
            raise InputError(f"sweep: {shortened(key)}", shown(values), "a list of values")
        texts = [value_text(value) for value in values]
        if len({*texts}) < len(texts):
            raise InputError(f"sweep: {shortened(key)}", shown(values), "values that differ")
    if (count := prod(map(len, keys.values()))) > MOST_CASES:
        raise InputError("sweep", f"{count} cases", f"at most {MOST_CASES}")
    shorts = short_names(list(keys))
    found: list[Variation] = []
    faults: list[InputError] = []
    for values in product(*keys.values()):
        texts = [value_text(value) for value in values]
        pairs = list(zip(shorts, texts, strict=True))
        setting = ", ".join(f"{short} = {text}" for short, text in pairs)
        changed = copy.deepcopy(data)
        for key, value in zip(keys, values, strict=True):
            _put(changed, key, copy.deepcopy(value))
        try:
            case = parse_case(changed, folder)
        except InputError as error:
            faults += [with_setting(fault, setting) for fault in getattr(error, "faults", (error,))]
            continue
        # letters, numbers and few signs
        name = "_".join(f"{short}={text}" for short, text in pairs)
        name = re.sub(r"[^\w.=+-]+", "-", name.replace(" ", "")).strip("-.")
        found.append(Variation(name, setting, tuple(texts), case))
    if faults:
        raise InputErrors(faults)
    names = {variation.name.lower() for variation in found}
    if len(names) == len(found) and max(map(len, names)) <= _LONGEST_NAME:
        return found
    # others would be too long, or the same on a file system
    return [replace(variation, name=f"case-{n}") for n, variation in enumerate(found, 1)]


def with_setting(error: InputError, setting: str) -> InputError:
    """The error of a case of a sweep, with the settings of the case."""
    return InputError(error.what, error.given, f"{error.expected} (with {shortened(setting)})")


def short_names(keys: Sequence[str]) -> tuple[str, ...]:
    """Last parts of dotted keys, as many as it takes to tell them apart.

    >>> short_names(["material.young", "counter_material.young", "stochastic.length"])
    ('material.young', 'counter_material.young', 'length')
    """

    def short(key: str) -> str:
        parts = key.split(".")
        names = (".".join(parts[-count:]) for count in range(1, len(parts) + 1))
        of_one = (n for n in names if sum(f".{one}".endswith(f".{n}") for one in keys) == 1)
        return next(of_one, key)

    return tuple(map(short, keys))


def value_text(value: Any) -> str:
    """A value as short text.

    >>> value_text([8, 16]), value_text("3 GPa"), value_text(True), value_text({"angle": "30 deg"})
    ('[8, 16]', '3 GPa', 'true', '{angle = 30 deg}')
    """
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, (list, tuple)):
        return f"[{', '.join(map(value_text, value))}]"
    if isinstance(value, Mapping):
        return f"{{{', '.join(f'{key} = {value_text(inner)}' for key, inner in value.items())}}}"
    return str(value)


def _put(data: dict[str, Any], key: str, value: Any) -> None:
    """Set a dotted key; tables on the way that do not exist are made."""
    inside: Any = data
    parts = key.split(".")
    for n, part in enumerate(parts):
        at: Any = part
        if isinstance(inside, list):
            if not part.isdecimal() or int(part) >= len(inside):
                expected = (
                    f"the number of one of the {len(inside)} tables '{'.'.join(parts[:n])}', from 0"
                )
                raise InputError(f"sweep: {shortened(key)}", shown(part), expected)
            at = int(part)
        elif isinstance(inside, dict) and part:
            inside.setdefault(part, {})
        else:
            expected = "a dotted key of the case, such as material.hardness"
            raise InputError("sweep", shown(key), expected)
        if n + 1 == len(parts):
            inside[at] = value
        inside = inside[at]
