"""Tabulate the load that each run requires to meet the leakage classes that all runs have in common."""

from __future__ import annotations

from collections.abc import Sequence
from math import isclose

from .load_steps import LoadFormat, load_format
from .needed_pressure import LoadText
from .results import Results
from .verdict import verdicts_of

#: Number of significant digits of the loads.
_DIGITS = 3
#: Largest relative difference between the forces of two runs at the same pressure that `_DIGITS` digits do not show.
_SAME_FORCE = 0.5 * 10.0**-_DIGITS


def common_load_text(runs: Sequence[Results]) -> LoadText:
    """Return a function that converts a nominal pressure to text.

    If the cases of all runs give forces on equal areas, the text is the force with the pressure in brackets. If a case
    gives pressures or the areas are different, the text is the pressure.
    """
    formats = [load_format(results.dataset, _DIGITS) for results in runs]
    first = formats[0]
    is_common = all(
        loads.unit == first.unit
        and isclose(loads.per_pascal, first.per_pascal, rel_tol=_SAME_FORCE)
        for loads in formats
    )
    return first.full if is_common else LoadFormat(digits=_DIGITS).full


def class_columns(runs: Sequence[Results]) -> list[tuple[str, list[str]]]:
    """Return a table column for each leakage class that all runs have, with the load that each run requires to meet it.

    Parameters
    ----------
    runs : sequence of Results
        Results of the runs.

    Returns
    -------
    list of (str, list of str)
        One pair per column: its heading, and one string per run. Each class has a column for the load at which the
        computed leakage meets the class. A second column, for the load at which the whole 95 % interval meets the
        class, is left out if a run has no interval.
    """
    verdicts = [{verdict.name: verdict for verdict in verdicts_of(results)} for results in runs]
    load_texts = [load_format(results.dataset, _DIGITS).short for results in runs]
    columns = []
    for name in verdicts[0]:
        if not all(name in of_run for of_run in verdicts):
            continue
        needed = [of_run[name].assembly for of_run in verdicts]
        pairs = list(zip(needed, load_texts, strict=True))
        computed = [load.words(load.computed, load_text) for load, load_text in pairs]
        columns.append((f"{name}, as computed", computed))
        if all(load.has_interval for load in needed):
            with_interval = [load.words(load.value, load_text) for load, load_text in pairs]
            columns.append((f"{name}, whole 95 % interval", with_interval))
    return columns
