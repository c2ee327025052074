"""Results in a few lines: for a terminal and for a notebook."""

from __future__ import annotations

import json
from html import escape
from typing import Any

import numpy as np

from ..base.quantities import to_text
from ..base.text import TextTable
from .pixel_fields import stored_steps
from .run_data import RunData
from .selections import solved_steps
from .tables import format_leakage, in_several_units, leakage_table


def summary_text(run: RunData) -> str:
    """Method and main results, a line each."""
    title = run.case.get("title", "")
    head = "femseal.Results" + (f" {title!r}" if title else "")
    lines = contents(run) | ({"folder": str(run.folder)} if run.folder else {})
    return "\n".join([f"<{head}>", *(f"{name:<10} {value}" for name, value in lines.items())])


def summary_html(run: RunData) -> str:
    """The lines, the table of the leakage, and a folded section on the origin of the numbers."""
    title = escape(run.case.get("title", "") or "femseal results")
    lines, origin = (TextTable("", (), tuple(each.items()))._repr_html_() for each in (contents(run), provenance(run)))
    return (
        f"<div><b>{title}</b>\n{lines}\n{leakage_table(run)._repr_html_()}\n"
        f"<details><summary>provenance</summary>{origin}</details></div>"
    )


def contents(run: RunData) -> dict[str, str]:
    """Name and text of the lines on the contents."""
    data, steps, peak = run.dataset, run.steps, run.peak
    unit, factor = run.leak_scale
    leakage = float(run.leakage[peak])
    text = format_leakage(leakage, factor) + (f" {unit.name}" if np.isfinite(leakage) and leakage != 0 else "")
    found = {"leakage": f"at {to_text(steps[peak].pressure, 'Pa')}: {text} ({run.method})"}
    if whole := in_several_units(run, peak):
        found["seal"] = f"{to_text(run.leak_basis.length, 'm')} long: {whole}"
    up = sum(step.unloaded_from is None for step in steps)
    peaks = sorted({step.unloaded_from for step in steps if step.unloaded_from is not None})
    down = f", {len(steps) - up} unloading from {', '.join(to_text(p, 'Pa') for p in peaks)}" if peaks else ""
    between = len(steps) - solved_steps(data).size
    found["load"] = f"{len(steps)} steps: {up} loading{down}" + (f"; {between} interpolated" if between else "")
    cells = [f"{data.sizes['cell1']} × {data.sizes['cell2']} windows"] if "window_pressure" in data else []
    if "realisation" in data.sizes:
        cells.append(f"{data.sizes['realisation']} realisations from {data.sizes['library_cell']} library cells")
    if cells:
        found["cells"] = ", ".join(cells)
    if stored := stored_steps(run):
        found["fields"] = f"over all pixels at {len(stored)} of {len(steps)} steps"
    for name, texts in (("warnings", run.warnings), ("failures", run.failures)):
        if texts:
            found[name] = f"{len(texts)}, the first: {texts[0]}"
    if missing := run.left_out:
        found["left out"] = "; ".join(missing)
    return found


def provenance(run: RunData) -> dict[str, str]:
    """Name and text of the lines on versions, machine, times and solvers."""
    attrs = run.dataset.attrs
    parts = {
        name: json.loads(attrs.get(name, "{}")) for name in ("timings", "machine", "counts", "solvers", "versions")
    }
    memory = {"memory_bytes": "", "peak_memory_bytes": " at the peak"}
    sizes = parts["machine"] | dict(attrs)
    machine = [str(value) for name, value in parts["machine"].items() if name in ("processor", "system")]
    machine += [f"{parts['machine']['cores']} cores"] if "cores" in parts["machine"] else []
    lines = {
        "computed": f"{attrs.get('date_created', '')} by {attrs['source']}",
        "seed": str(attrs.get("seed", "")),
        "machine": ", ".join(machine),
        "memory": ", ".join(to_text(sizes[name], "B", 3) + end for name, end in memory.items() if name in sizes),
        "wall times": ", ".join(f"{stage} {seconds:.3g} s" for stage, seconds in parts["timings"].items()),
        "flows": "; ".join(
            f"{study.replace('_', '-')}: " + ", ".join(f"{count} {kind}" for kind, count in counts.items())
            for study, counts in parts["counts"].items()
        ),
        "linear systems": "; ".join(
            f"{study.replace('_', '-')}: {solvers_text(solvers)}" for study, solvers in parts["solvers"].items()
        ),
        "versions": ", ".join(f"{name} {number}" for name, number in parts["versions"].items()),
    }
    return {name: value for name, value in lines.items() if value}


def solvers_text(solvers: dict[str, Any]) -> str:
    """How many linear systems each solver solved, and their worst imbalance; from the attribute `solvers`."""
    systems = ", ".join(f"{count} by {name}" for name, count in solvers["systems"].items())
    return f"{systems}, worst imbalance {solvers['worst_imbalance']:.0e}" if systems else "none to solve"
