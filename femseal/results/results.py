"""Results of a case: what a run has found, with selections, tables, pictures, files, and a summary in a few lines."""

from __future__ import annotations

import json
import os
from dataclasses import dataclass
from html import escape
from math import inf, log1p
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..base import InputError, Plotted, TextTable, counted, duration, format_deviation, to_si, to_text
from ..base.text import room
from . import tables
from .export import export_field
from .paraview import read_pixels, stored_steps
from .run_data import RunData
from .selections import Steps, branches_in, piece
from .tables import format_leakage, in_several_units, leakage_table

if TYPE_CHECKING:
    import xarray

#: Text where a column has nothing to say.
_NONE = "–"


def attempt_sentences(found: dict[str, Any]) -> list[str]:
    """Whether the accuracy is met, what limits it, and what half the error takes."""
    wanted, error = format_deviation(log1p(found["wanted"])), _half_width(found)
    met = "" if found["reached"] else "not "
    lines = [
        f"The accuracy of {wanted} is {met}reached: the leakage is known within {error} at all loads that leak more "
        "than 1/1000 of the first, by the numbers alone of its error budget."
    ]
    if model := found.get("model_parts"):
        both = format_deviation(inf if found["with_model"] is None else found["with_model"])
        lines.append(f"With the model and its input ({', '.join(model)}) it is known within {both}.")
    if found["half_width"] != 0:
        # "pixels" and "realisations" are several
        verb = "limit" if found["limit"].endswith("s") else "limits"
        lines.append(f"The {found['limit']} {verb} it, most at {found['load']}.")
    if found["why"]:
        lines.append(f"No further attempt: {found['why']}.")
    if found["half_width"] != 0 and not (found["why"] and found["half_error"].startswith("cannot")):
        lines.append(f"Half the error: {found['half_error']}.")
    return lines


def attempts_table(found: dict[str, Any]) -> TextTable:
    """A line for each attempt, without columns in which nothing stands; the sentences are its notes."""
    attempts = found["attempts"]
    settings = [attempt["settings"] for attempt in attempts]
    columns: dict[str, list[str]] = {
        "attempt": [str(number) for number in range(1, len(attempts) + 1)],
        "method": [each["method"] for each in settings],
        "points": [" × ".join(map(str, attempt["points"])) for attempt in attempts],
        "residual": [f"{each['rtol']:.0e}" for each in settings],
        "seals": [_count(each["realisations"]) for each in settings],
        "time": [duration(attempt["with_coarse"]) for attempt in attempts],
        "error": [_half_width(attempt) for attempt in attempts],
        "limited by": [attempt["limit"] for attempt in attempts],
    }
    shown = [(head, texts) for head, texts in columns.items() if any(text != _NONE for text in texts)]
    return TextTable.of_columns("", shown, names=len(shown), notes=(" ".join(attempt_sentences(found)),))


def as_chosen(case: dict[str, Any], found: dict[str, Any] | None) -> dict[str, Any]:
    """A case whose keys have the values of the last attempt; it is the same without attempts.

    Keys that the case gives have them already, others hold defaults that were not taken.
    """
    if found is None:
        return case
    chosen = found["settings"]
    drawn = case.get("stochastic")
    if drawn is not None and chosen["realisations"] is not None:
        drawn = drawn | {"realisations": chosen["realisations"]}
    changed = {"method": chosen["method"], "contact": case["contact"] | {"rtol": chosen["rtol"]}}
    return case | changed | ({} if drawn is None else {"stochastic": drawn})


def _count(number: int | None) -> str:
    return _NONE if number is None else str(number)


def _half_width(found: dict[str, Any]) -> str:
    width = found["half_width"]
    return format_deviation(inf if width is None else width)


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
    found["load"] = f"{counted(len(steps), 'step')}: {up} loading{down}"
    if "piece1" in data.dims:
        found["pieces"] = f"{data.sizes['piece1']} × {data.sizes['piece2']}"
    if "realisation" in data.dims:
        drawn = counted(data.sizes["realisation"], "realisation")
        pieces = f"{data.sizes['state_piece1']} × {data.sizes['state_piece2']} pieces"
        found["drawn"] = f"{drawn} of {data.attrs['tiles']}, from {pieces} in {counted(data.sizes['state'], 'state')}"
    if stored := stored_steps(run):
        found["fields"] = f"over all pixels at {len(stored)} of {counted(len(steps), 'step')}"
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


@dataclass(frozen=True, eq=False, repr=False)
class Results(RunData, Plotted):
    """Results of a case, see `RunData`; `dataset` holds every number with its unit."""

    export = export_field
    pixels = read_pixels
    rows = tables.rows
    table = tables.leakage_table

    def loading(self) -> xarray.Dataset:
        """Leakage and all other variables over the steps, on loading, over `nominal_pressure` [Pa]."""
        return self._over_pressure(branches_in(self.dataset)[0][1])

    def unloading(self, from_: float | str | None = None) -> xarray.Dataset:
        """The same on unloading, beginning with the peak.

        Parameters
        ----------
        from_ : the peak, in Pa or as "900 MPa"; the highest one unless given.

        Raises
        ------
        InputError : no unloading from there.
        """
        parts = branches_in(self.dataset)[1:]
        if not parts:
            raise InputError("from_", from_, "nothing: the cycle has no unloading")
        peaks = [float(self.dataset["nominal_pressure"][steps[0]]) for _, steps in parts]
        wanted = max(peaks) if from_ is None else to_si(from_, "Pa", "from_") if isinstance(from_, str) else from_
        for peak, (_, steps) in zip(peaks, parts, strict=True):
            if np.isclose(peak, wanted, rtol=1e-9, atol=0):
                return self._over_pressure(steps)
        raise InputError("from_", from_, f"one of {', '.join(to_text(p, 'Pa') for p in sorted(peaks))}")

    def _over_pressure(self, steps: Steps) -> xarray.Dataset:
        names = [name for name, variable in self.dataset.data_vars.items() if "step" in variable.dims]
        return self.dataset[names].isel(step=steps).swap_dims(step="nominal_pressure")

    def piece(self, i: int, j: int) -> xarray.Dataset:
        """Curves of the piece (i, j) over the steps of a two-scale study, else over the states that seals draw from.

        Raises InputError: no such piece, or results without pieces.
        """
        data = self.dataset
        prefix = "" if "piece1" in data.dims or "state" not in data.dims else "state_"
        one, two = f"{prefix}piece1", f"{prefix}piece2"
        at = dict(zip((one, two), piece(data, i, j, (one, two)), strict=True))
        return data[[name for name, variable in data.data_vars.items() if one in variable.dims]].isel(at)

    def gap(self, step: int, piece: tuple[int, int] | None = None) -> xarray.DataArray:
        """Deformed gap (x1, x2) [m] at one step, see `pixels`."""
        return self.pixels("gap", step, piece)

    def contact_pressure(self, step: int, piece: tuple[int, int] | None = None) -> xarray.DataArray:
        """Contact pressure (x1, x2) [Pa] at one step, see `pixels`."""
        return self.pixels("contact_pressure", step, piece)

    def fluid_pressure(self, step: int, piece: tuple[int, int] | None = None) -> xarray.DataArray:
        """Fluid pressure (x1, x2) [Pa] at one step, NaN where none flows, see `pixels`."""
        return self.pixels("fluid_pressure", step, piece)

    @property
    def stored_steps(self) -> list[int]:
        """Steps whose fields over all pixels are in memory or in the folder."""
        return stored_steps(self)

    def attempts_table(self) -> TextTable:
        """The attempts at the accuracy that the case asks for, to be given to `rich.print`.

        Raises InputError: a case that asks for no accuracy.
        """
        if self.attempts is None:
            raise InputError("attempts", "a case that asks for no accuracy", "one with the key accuracy")
        return attempts_table(self.attempts)

    def plot_pieces(self) -> Any:
        """Permeability of pieces over their mean gap and their pressure, see `pieces_figure`."""
        return room("plots").shown(room("plots").pieces_figure(self))

    def plot_seal(self, step: int | None = None) -> Any:
        """Contact, fluid pressure and permeability over the seal at one step, see `seal_figure`."""
        return room("plots").shown(room("plots").seal_figure(self, step))

    def report(self, path: str | os.PathLike[str] | None = None) -> Path:
        """Write the report, `report.html` in the folder unless `path` is given, see `write_report`."""
        return room("report").write_report(self, path)

    __repr__ = summary_text
    _repr_html_ = summary_html
