"""The error of a leakage in one number: the widest band at the loads that count."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf

import numpy as np

from ..studies.load_curves import FLOOR
from ..studies.scene import Array
from .error_parts import ErrorBudget


@dataclass(frozen=True)
class WidestBand:
    """The widest band of a budget at the loads that count, see `counting_steps`.

    half_width : of ln(leakage), see `ErrorBudget.half_width`; inf where it is unknown or has no end. step : index of
    the load where it is widest. limit : the widest part at any of the loads. parts : half-width of every part, the
    widest at any of the loads.
    """

    half_width: float
    step: int
    limit: str
    parts: dict[str, float]


def counting_steps(budget: ErrorBudget) -> np.ndarray:
    """Indices of the loads at which the leakage is more than 1e-3 of the first, or unknown.

    Where nothing leaks at the first load, all count that leak or may do so. Others that are found sealed do not count:
    the wide bands at the loads before them tell if they may be open.
    """
    q, upper = np.abs(budget.leakage), np.abs(budget.upper)
    if q[0] == 0:
        return np.flatnonzero((q != 0) | (upper != 0))
    return np.flatnonzero((q > FLOOR * (q[0] if np.isfinite(q[0]) else 0.0)) | np.isnan(q))


def widest_band(budget: ErrorBudget) -> WidestBand:
    """Judge a budget. Pixels of which nothing is known have no end."""
    steps = counting_steps(budget)
    widths = np.nan_to_num(np.asarray(budget.half_width())[steps], nan=inf, posinf=inf)
    parts = {"pixels": inf} | {name: _largest(width[steps]) for name, width in budget.widths().items()}
    return WidestBand(
        half_width=max(_largest(widths), inf if np.isinf(parts["pixels"]) else 0.0),
        step=int(steps[np.argmax(widths)]) if steps.size else 0,
        limit=max(parts, key=lambda name: parts[name]),
        parts=parts,
    )


def _largest(widths: Array) -> float:
    return float(np.max(np.nan_to_num(widths, nan=inf, posinf=inf), initial=0.0))
