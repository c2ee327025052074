"""Tabulate for several runs the load from which on each meets the leakage classes that their cases have in common."""

from __future__ import annotations

from collections.abc import Sequence

from ..base import to_text
from .load_steps import loads_as_given
from .results import Results
from .verdict import LoadText, verdicts_of
from .verdict_text import short_loads

#: Nominal pressures [Pa] at which the texts of the loads of several runs are compared.
_COMPARED_PRESSURES = (1e6, 1e7, 1e8)


def common_load_text(runs: Sequence[Results]) -> LoadText:
    """Return a function that converts a nominal pressure to text.

    The text is the force with the pressure in brackets if all cases give forces on the same area, else the pressure.
    """
    functions = [loads_as_given(results.dataset, 3) for results in runs]
    texts = {tuple(map(function, _COMPARED_PRESSURES)) for function in functions}
    if len(texts) == 1:
        return functions[0]
    return lambda pressure: to_text(pressure, "Pa", 3)


def class_columns(runs: Sequence[Results]) -> list[tuple[str, list[str]]]:
    """Return two columns for each class that all cases have: the load that it needs, and with the whole 95 % interval.

    Parameters
    ----------
    runs : sequence of Results
        Results of the runs.

    Returns
    -------
    list of (str, list of str)
        Heading of each column, and a text for each run. The column of the interval is left out if a run has none.
    """
    verdicts = [{verdict.name: verdict for verdict in verdicts_of(results)} for results in runs]
    load_texts = [short_loads(results) for results in runs]
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
