"""Speed against error for a case: its scene solved at several resolutions, window sizes and library sizes.

`measure_accuracy` plans the solutions (`plan.py`), times them, and compares their leakage with the best affordable one
(`studies/curve_distance.py`), with the error budget of each; its `AccuracyReport` prints and writes the comparison, and
recommends a solution (`table.py`).
"""

from ..studies.curve_distance import LeakageFactor, closing_load, leakage_factor
from .measure import measure_accuracy
from .plan import Plan, Variant, make_plan
from .table import AccuracyReport, Comparison, Solution

__all__ = [
    "AccuracyReport",
    "Comparison",
    "LeakageFactor",
    "Plan",
    "Solution",
    "Variant",
    "closing_load",
    "leakage_factor",
    "make_plan",
    "measure_accuracy",
]
