"""Results in a few lines: for a terminal and for a notebook."""

from __future__ import annotations

import json
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np

from ..base.quantities import to_text
from . import tables
from .interpolated import solved_steps

if TYPE_CHECKING:
    from .results import Results


def text(results: Results) -> str:
    """Method and main results, a line each."""
    title = results.case.get("title", "")
    head = "femseal.Results" + (f" {title!r}" if title else "")
    lines = facts(results) | ({"folder": str(results.folder)} if results.folder else {})
    return "\n".join([f"<{head}>", *(f"{name:<10} {value}" for name, value in lines.items())])


def html(results: Results) -> str:
    """The lines, the table of the leakage, and a folded section on the origin of the numbers."""
    title = escape(results.case.get("title", "") or "femseal results")
    lines = _html_lines(facts(results))
    origin = _html_lines(provenance(results))
    return (
        f"<div><b>{title}</b>\n<table>{lines}</table>\n{tables.html_table(results)}\n"
        f"<details><summary>provenance</summary><table>{origin}</table></details></div>"
    )


def facts(results: Results) -> dict[str, str]:
    """Name and text of the lines on the contents."""
    data, steps = results.dataset, results.steps
    peak = max(range(len(steps)), key=lambda s: steps[s].pressure)
    found = {"leakage": f"at {to_text(steps[peak].pressure, 'Pa')}: {_leakage(results, peak)} ({results.method})"}
    if whole := tables.in_several_units(results, peak):
        found["seal"] = f"{to_text(results.leak_basis.length, 'm')} long: {whole}"
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
    if stored := results.stored_steps:
        found["fields"] = f"over all pixels at {len(stored)} of {len(steps)} steps"
    for name, told in (("warnings", results.warnings), ("failures", results.failures)):
        if told:
            found[name] = f"{len(told)}, the first: {told[0]}"
    if missing := results.left_out:
        found["left out"] = "; ".join(missing)
    return found


def provenance(results: Results) -> dict[str, str]:
    """Name and text of the lines on versions, machine, times and solvers."""
    attrs = results.dataset.attrs
    told = {name: json.loads(attrs.get(name, "{}")) for name in ("timings", "machine", "counts", "solvers", "versions")}
    memory = "memory_bytes", "peak_memory_bytes"
    sizes = {name: value for name, value in (told["machine"] | dict(attrs)).items() if name in memory}
    machine = [str(value) for name, value in told["machine"].items() if name in ("processor", "system")]
    machine += [f"{told['machine']['cores']} cores"] if "cores" in told["machine"] else []
    lines = {
        "computed": f"{attrs.get('date_created', '')} by {attrs['source']}",
        "seed": str(attrs.get("seed", "")),
        "machine": ", ".join(machine),
        "memory": ", ".join(
            f"{to_text(sizes[name], 'B', 3)}{' at the peak' if name.startswith('peak') else ''}"
            for name in memory
            if name in sizes
        ),
        "wall times": ", ".join(f"{stage} {seconds:.3g} s" for stage, seconds in told["timings"].items()),
        "flows": "; ".join(
            f"{study.replace('_', '-')}: " + ", ".join(f"{count} {kind}" for kind, count in counts.items())
            for study, counts in told["counts"].items()
        ),
        "linear systems": "; ".join(
            f"{study.replace('_', '-')}: {solvers_text(solvers)}" for study, solvers in told["solvers"].items()
        ),
        "versions": ", ".join(f"{name} {number}" for name, number in told["versions"].items()),
    }
    return {name: value for name, value in lines.items() if value}


def solvers_text(solvers: dict[str, Any]) -> str:
    """How many linear systems each solver solved, and their worst imbalance; from the attribute `solvers`."""
    systems = ", ".join(f"{count} by {name}" for name, count in solvers["systems"].items())
    return f"{systems}, worst imbalance {solvers['worst_imbalance']:.0e}" if systems else "none to solve"


def _leakage(results: Results, step: int) -> str:
    leakage = float(results.leakage[step])
    unit = results.leak_unit
    value = tables.amount(leakage, results.leak_basis.factor(unit))
    return f"{value} {unit.name}" if np.isfinite(leakage) and leakage != 0 else value


def _html_lines(lines: dict[str, str]) -> str:
    return "".join(
        f"<tr><th style='text-align:left'>{escape(name)}</th><td>{escape(value)}</td></tr>"
        for name, value in lines.items()
    )
