"""Branches of a load cycle: their names and steps."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..base.quantities import to_text

Array = NDArray[np.float64]
Steps = NDArray[np.int64]


def branch_text(unloaded_from: float | None) -> str:
    """Name of a branch: "loading", or "unloading from 900 MPa"; `unloaded_from` [Pa], NaN or None on loading."""
    if unloaded_from is None or np.isnan(unloaded_from):
        return "loading"
    return f"unloading from {to_text(unloaded_from, 'Pa')}"


def branches(pressure: Array, peaks: Array) -> list[tuple[str, Steps]]:
    """Name and steps of the loading and of each unloading, which begins at its peak on the loading.

    pressure, peaks : nominal pressure of each step, and the one it is unloaded from, NaN on loading [Pa].
    """
    loading = np.flatnonzero(np.isnan(peaks))
    found = [("loading", loading)]
    for peak in np.unique(peaks[~np.isnan(peaks)])[::-1]:
        start = loading[pressure[loading] == peak]
        found.append((branch_text(float(peak)), np.r_[start, np.flatnonzero(peaks == peak)]))
    return found


def pressures_and_peaks(steps: Sequence[Any]) -> tuple[Array, Array]:
    """Nominal pressures and peaks of load steps as `branches` takes them [Pa]."""
    peaks = [np.nan if s.unloaded_from is None else s.unloaded_from for s in steps]
    return np.array([s.pressure for s in steps], dtype=float), np.array(peaks, dtype=float)
