"""Tables of the report on the error of the numbers: budget of errors, checks, times."""

import json

import numpy as np

from ..base import TextTable, format_deviation, to_text
from ..results.results import Results
from ..results.selections import load_names
from ..results.summary import as_chosen
from ..studies.load_curves import first_known, least_counted

Lines = list[tuple[str, ...]]


def important_steps(results: Results) -> list[int]:
    """The first load, the highest, the highest that leaks more than 1e-3 of the first, and the last one."""
    leakage, steps = np.abs(results.leakage.values), results.steps
    least = least_counted(leakage)
    peak = max(range(len(steps)), key=lambda s: steps[s].pressure)
    leaking = [
        s for s in range(len(steps)) if leakage[s] > least and steps[s].unloaded_from is None
    ]
    return list(dict.fromkeys((first_known(leakage), *leaking[-1:], peak, len(steps) - 1)))


def budget_table(results: Results) -> TextTable | None:
    """A line for each source, the widest first, and one for all together; None without a budget."""
    budget = results.budget
    if budget is None:
        return None
    steps, widths = important_steps(results), budget.widths()
    largest = {
        name: float(np.max(np.nan_to_num(width[steps], nan=np.inf), initial=0.0))
        for name, width in widths.items()
    }
    order = sorted(budget.parts, key=lambda part: -largest[part.name])
    together = "root of the sum of squares of the distances of ln(leakage)"
    lines = [(part.name, widths[part.name], part.note) for part in order]
    if len(budget.numerical.parts) < len(budget.parts):
        text = "without the model and its input (hardness, fluid pressure, form, …): what an accuracy asks for"
        lines.append(("numbers alone", np.asarray(budget.numerical.half_width()), text))
    lines.append(("together", np.asarray(budget.half_width()), together))
    names = load_names(results.dataset)
    heads = ("source", *(names[s] for s in steps), "how it was estimated")
    texts = tuple(
        (name, *(_width_text(float(width[s])) for s in steps), note) for name, width, note in lines
    )
    title = "Half-width of the band of error, by its source, the widest first; ×: a factor"
    name = budget.limiting()
    notes = (
        "The band of error of a leakage holds the truth in about 95 of 100 cases: the leakage of such a face on pixels "
        "as fine as one wants, with the waves that were removed, and without errors of method or draws.",
        f"Over the loads that leak more than 1e-3 of the first the widest source is: {name}."
        if name
        else "",
    )
    return TextTable(title, heads, texts, names=len(heads), notes=tuple(filter(None, notes)))


def _width_text(width: float) -> str:
    """A half-width of ln(leakage); inf is that of a seal that may leak or be sealed."""
    known = {"nan": "unknown", "inf": "open or sealed", "0": "0"}.get(f"{width:g}")
    return format_deviation(width, "× ") if known is None else known


def most_leaking_place(results: Results) -> str:
    """Which of several measured places leaks most by itself, and how much, over the loads that count."""
    about = results.dataset["place_height"].attrs
    count = results.dataset.sizes["place"]
    if not about["over_mean"]:
        return f"place {about['place']} of {count}, of which none leaks"
    return (
        f"place {about['place']} of {count} leaks most, {about['over_mean']:.3g} times their mean"
    )


def check_lines(results: Results) -> Lines:
    """Residuals and resolution: quantity, value, meaning."""
    data, case = results.dataset, as_chosen(results.case, results.attempts)
    lines: Lines = []
    if (rtol := case.get("contact", {}).get("rtol")) is not None:
        lines.append(
            ("contact residual", f"≤ {rtol:.0e}", "of every contact that is not among the failures")
        )
    if first := data.attrs.get("first_answer"):
        lines.append(
            (
                "first answer",
                str(first),
                "leakage on loading that would be plausible, beside that computed",
            )
        )
    surface = json.loads(data.attrs["surface"])
    if "shortest_wave" in surface and "spacing" in surface:
        wave, pixel = surface["shortest_wave"], max(surface["spacing"])
        meaning = f"of {to_text(pixel, 'm', 3)} to the shortest wave, {to_text(wave, 'm', 3)}"
        lines.append(("resolution", f"{wave / pixel:.3g} pixels", meaning))
        if (before := surface.get("rms_slope_before")) and "continuation" not in surface:
            lost = 1 - surface["rms_slope"] / before
            meaning = "of the rms slope, with the waves shorter than that"
            lines.append(("slope removed", f"{100 * lost:.2g} %", meaning))
    return lines


def time_lines(results: Results) -> list[tuple[str, str, float]]:
    """Stage, time, and its fraction of the whole in percent; parts of a study are left out."""
    timings: dict[str, float] = json.loads(results.dataset.attrs["timings"])
    stages = {name: seconds for name, seconds in timings.items() if ": " not in name}
    whole = sum(stages.values()) or 1.0
    return [(name, f"{t:.3g} s", 100 * t / whole) for name, t in stages.items()]
