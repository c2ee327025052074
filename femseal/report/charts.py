"""Curves of the page that can be hovered and zoomed: their numbers, for uPlot, whose code is in the page.

The page's policy names its script by its digest, and nothing is loaded. Each curve has a picture, which stands in its
place without scripts and on paper. uPlot 1.6.32 is in `uplot/`, with its licence.
"""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Sequence
from importlib.resources import files
from typing import Any

import numpy as np

from ..base.arrays import Array
from ..plots.drawing import GREY, branch_styles
from ..plots.leakage_curves import leakage_curves, leakage_range
from ..plots.maps import pressure_rows
from ..results.results import Results
from ..results.selections import branches
from ..results.tables import format_error_band, format_leakage, leakage_of

Chart = dict[str, Any]


def page_code() -> dict[str, str]:
    """Script and style of the page's charts, and the script's digest for the policy of the page."""
    folder = files("femseal.report")
    read = [folder.joinpath(name).read_text(encoding="utf-8") for name in ("uplot/uPlot.iife.min.js", "charts.js")]
    # a section of plain characters, so that the page is XML too
    script = "//<![CDATA[\n" + "".join(read) + "//]]>"
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    style = folder.joinpath("uplot/uPlot.min.css").read_text(encoding="utf-8").strip()
    return {"script": script, "script_digest": f"sha256-{digest}", "chart_style": style}


def leakage_chart(results: Results) -> Chart:
    """Leakage over load, a curve for each branch, with the band of error as bars and the limits of classes."""
    curves, (unit, factor) = leakage_curves(results), results.leak_scale
    low, high = leakage_range(curves, factor)
    loads = np.unique(curves.pressure)
    parts = branches(curves.pressure, curves.peaks)
    series = []
    for (name, steps), (colour, *_) in zip(parts, branch_styles(len(parts)), strict=True):
        one = _series(name, colour, loads.size)
        if curves.error is not None:
            one |= {"low": [None] * loads.size, "high": [None] * loads.size}
        for s in steps:
            n, value = int(np.searchsorted(loads, curves.pressure[s])), abs(float(curves.leakage[s]))
            one["texts"][n] = format_leakage(value, factor)
            one["values"][n] = None if np.isnan(value) else max(value / factor, low)
            if curves.error is not None:
                lower, upper = (abs(float(end[s])) for end in curves.error)
                one["texts"][n] += f", band {format_error_band(lower, upper, factor)}"
                one["low"][n], one["high"][n] = (_number(min(end / factor, 10 * high)) for end in (lower, upper))
        series.append(one)
    for name, limit in curves.limits.items():
        if low <= limit / factor <= high:
            series.append(
                _series(name, GREY, loads.size, [6, 4])
                | {"points": False, "values": [limit / factor] * loads.size}
                | {"texts": [format_leakage(limit, factor)] * loads.size}
            )
    caption = "Leakage against nominal pressure; points at the lower edge are sealed."
    caption += (
        " Bars: band of error, which holds the truth in about 95 of 100 cases." if curves.error is not None else ""
    )
    what = f"{leakage_of(results).rstrip(',')} [{unit.name}]"
    return _chart("nominal pressure [MPa]", loads / 1e6, what, (low, high), series, caption, log_y=True)


def drop_chart(results: Results, steps: Sequence[int]) -> Chart:
    """Fluid pressure along the leakage at some steps, mean over the length of the seal."""
    data, series, x = results.dataset, [], np.empty(0)
    for s, (colour, *_) in zip(steps, branch_styles(len(steps)), strict=True):
        x, p = pressure_rows(data, s)
        values = [_number(value) for value in np.ma.filled(p.mean(axis=1), np.nan) / 1e6]
        texts = ["–" if value is None else f"{value:.4g}" for value in values]
        series.append(_series(str(data["name"].values[s]), colour, len(x)) | {"values": values, "texts": texts})
    known = [value for one in series for value in one["values"] if value is not None] or [0.0, 1.0]
    margin = 0.05 * (max(known) - min(known) or 1.0)
    span = min(known) - margin, max(known) + margin
    caption = "Fluid pressure along the leakage, mean over the length of the seal."
    return _chart("x1, inlet at 0 [mm]", x * 1e3, "fluid pressure [MPa]", span, series, caption)


def _series(label: str, colour: str, count: int, dash: Sequence[int] = ()) -> dict[str, Any]:
    return {"label": label, "colour": colour, "dash": list(dash), "points": True,
            "values": [None] * count, "texts": [None] * count}  # fmt: skip


def _chart(
    x_label: str,
    x: Array,
    y_label: str,
    span: tuple[float, float],
    series: list[dict[str, Any]],
    caption: str,
    log_y: bool = False,
) -> Chart:
    """What `charts.js` takes; the horizontal axis of a logarithmic chart is logarithmic too, but for a load of 0."""
    log_x = log_y and bool(x[0] > 0 and x[-1] > 3 * x[0])
    margin = (x[-1] / x[0]) ** 0.02 if log_x else 0.02 * (x[-1] - x[0]) or 1.0
    ends = (x[0] / margin, x[-1] * margin) if log_x else (x[0] - margin, x[-1] + margin)
    return {
        "x": {"label": x_label, "values": [float(v) for v in x], "log": log_x, "range": [float(end) for end in ends]},
        "y": {"label": y_label, "log": log_y, "range": [float(end) for end in span]},
        "series": series,
        "caption": caption,
    }


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
