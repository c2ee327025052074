"""A run beside the first answer by the spectrum of its face, and whether the model holds its flow."""

from __future__ import annotations

import json

import numpy as np

from ..base import Array, to_text
from ..materials import LINE_CONTACT_YIELD
from ..preparation.prepared import Prepared
from ..results import Results
from ..studies.doubts import flow_warnings


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
    if prepared.sampling is not None and prepared.sampling.form and "largest_row_pressure" in data:
        doubts += _yielding_body(
            prepared.scene.law.mean_hardness, data["largest_row_pressure"].values
        )
    if doubts:
        data.attrs["warnings"] = json.dumps([*results.warnings, *doubts], ensure_ascii=False)


def _yielding_body(hardness: float, pressure: Array) -> list[str]:
    """A sentence where the largest pressures of a form (steps,) [Pa] make the body below it yield."""
    highest, limit = float(np.nanmax(pressure)), LINE_CONTACT_YIELD * hardness
    if not highest > limit:
        return []
    return [
        f"a form presses with up to {to_text(highest, 'Pa', 3)}, and the body below a line contact yields from "
        f"{to_text(limit, 'Pa', 3)} on, 1.79 of its yield strength: the band becomes broader than the model has it"
    ]
