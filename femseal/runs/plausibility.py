"""A run beside the first answer by the spectrum of its face, and whether the model holds its flow."""

from __future__ import annotations

import json

import numpy as np

from ..preparation.prepared import Prepared
from ..results import Results
from ..studies.flow_limits import flow_warnings


def add_plausibility(prepared: Prepared, results: Results) -> None:
    """Put the first answer beside the results, and warn of what is not plausible."""
    data, leakage = results.dataset, results.leakage.values
    doubts, gaps = [], np.full(len(leakage), np.nan)
    if (first := prepared.first_answer) is not None:
        data.attrs["first_answer"] = str(first)
        doubts, gaps = first.doubts(leakage, list(data["name"].values)), first.mean_gap
    if "mean_gap" in data:
        gaps = data["mean_gap"].values
    doubts += flow_warnings(prepared.scene, leakage, gaps)
    if doubts:
        data.attrs["warnings"] = json.dumps([*results.warnings, *doubts], ensure_ascii=False)
