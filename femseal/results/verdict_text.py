"""Put the verdicts on leakage classes into words: sentences on a single class, and a table of all classes."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from math import inf

from ..base import TextTable
from ..base.leak_classes import find_leak_classes
from ..base.leak_units import LEAK_UNITS
from .leakage_format import format_leakage
from .load_steps import load_format
from .needed_pressure import LoadText, NeededPressure
from .results import Results
from .verdict import WHOLE_INTERVAL, Verdict


def verdict_sentences(verdict: Verdict, load_text: LoadText, *, whole: bool = True) -> list[str]:
    """Put a verdict into words: whether the class is met at the assembly load, and which loads are required.

    Parameters
    ----------
    verdict : Verdict
        Verdict on a leakage class.
    load_text : callable
        Function that converts a nominal pressure [Pa] to text.
    whole : bool
        True to state the required loads, False to state only whether the class is met at the assembly load.

    Returns
    -------
    list of str
        Sentences. The first sentence says whether the class is met at the assembly load.
    """
    subject = f"Class {verdict.name} with {verdict.fluid}"
    if verdict.is_own_limit:
        subject = f"At most {verdict.name} of {verdict.fluid}"
    assembly_load = load_text(verdict.assembly_load)
    sentences = [f"{subject}: {verdict.answer}, at the assembly load of {assembly_load}."]
    if not whole:
        return sentences
    sentences.append(f"On loading it is met {required_loads(verdict.assembly, load_text)}.")
    for peak, needed in verdict.service.items():
        if needed.computed == inf:  # the class is not even met at the peak
            continue
        sentences.append(
            f"Unloaded from {load_text(peak)} it is kept {required_loads(needed, load_text)}."
        )
    if verdict.failed:
        loads = ", ".join(verdict.failed)
        sentences.append(f"The solution failed at {loads}: such a load counts as not met.")
    return sentences


def required_loads(needed: NeededPressure, load_text: LoadText) -> str:
    """Say at which loads the computed leakage is within a limit, and at which loads its whole 95 % interval is too."""
    as_computed = needed.words(needed.computed, load_text)
    if not needed.has_interval:
        return f"{as_computed} as computed"
    with_interval = needed.words(needed.value, load_text)
    if with_interval == as_computed:
        return f"{as_computed}, as computed and with {WHOLE_INTERVAL}"
    return f"{as_computed} as computed, and {with_interval} with {WHOLE_INTERVAL}"


def verdict_table(
    results: Results,
    verdicts: Sequence[Verdict],
    more: Iterable[tuple[str, Iterable[str]]] = (),
    names: tuple[str, str] = ("met", "kept after {}"),
) -> TextTable:
    """Return a table with a line for each verdict.

    The columns are the class, the limit of the class, and the required loads. Each required load has two columns, one
    for the computed leakage to meet the class, and one for the whole 95 % interval to meet it.

    Parameters
    ----------
    results : Results
        Results of a run.
    verdicts : sequence of Verdict
        Verdicts, at least one.
    more : iterable
        Additional columns, each a pair of the heading and the list of strings below it.
    names : (str, str)
        First words of two column headings: one for the load required to meet a class on loading, the other for the
        lowest load on unloading at which it is still met. The placeholder {} in the second heading is replaced by the
        load from which the seal is unloaded.
    """
    load_text = load_format(results.dataset, 3).short
    columns: list[tuple[str, list[str]]] = [("class", [verdict.name for verdict in verdicts])]
    if not all(verdict.is_own_limit for verdict in verdicts):
        columns.append(("limit", limit_texts(results, verdicts)))
    met, kept = names
    required = [(met, [verdict.assembly for verdict in verdicts])]
    for peak in verdicts[0].service:
        heading = kept.format(load_text(peak))
        required.append((heading, [verdict.service[peak] for verdict in verdicts]))
    for heading, pressures in required:
        texts = [pressure.words(pressure.computed, load_text) for pressure in pressures]
        columns.append((f"{heading}, as computed", texts))
        if pressures[0].has_interval:
            texts = [pressure.words(pressure.value, load_text) for pressure in pressures]
            columns.append((f"{heading}, with {WHOLE_INTERVAL}", texts))
    columns += [(heading, list(texts)) for heading, texts in more]
    title = f"Leakage classes, decided by {verdicts[0].fluid}"
    return TextTable.of_columns(title, columns, names=len(columns))


def limit_texts(results: Results, verdicts: Sequence[Verdict]) -> list[str]:
    """Return the limit of each verdict as text, in the unit of its class."""
    classes = find_leak_classes([verdict.name for verdict in verdicts])
    texts = []
    for verdict, leak_class in zip(verdicts, classes, strict=True):
        unit = LEAK_UNITS[leak_class.unit]
        factor = results.class_basis.factor(unit)
        limit = f"{format_leakage(verdict.limit, factor)} {unit.name}"
        texts.append(limit if verdict.limit else "no leakage")
    return texts
