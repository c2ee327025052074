"""Estimate the error of a leakage, source by source: solver, pixels, filter, realisations, measured patch and model.

`sources.py` lists all error sources, both for a run and for the forecast of its cost. Each error source names the
modified versions of the input that must be solved (`versions.py`), and estimates its error from their leakages, which
`evaluation.py` solves. `budgets.py` makes one error budget for the leakage of each study. `estimates.py`,
`pixel_size.py` and `missing_waves.py` estimate its numerical errors, `changed_models.py` estimates the errors of the
model, and `error_parts.py` combines all error sources into one interval. `leakage_changes.py` makes an error source
from the change of the leakage to a second solution. All errors are expressed on the logarithmic scale, as distances
from ln(leakage), because the uncertainty of the leakage near closing is a factor rather than a difference.
"""

from typing import TYPE_CHECKING

from ..base.lazy_package import lazy

if TYPE_CHECKING:
    from .budgets import budgets_of, versions_of_budget
    from .changed_models import (
        FormTolerance,
        ModelChange,
        model_changes,
        model_part,
        opposite_matters,
    )
    from .error_parts import ErrorBudget, ErrorPart
    from .estimates import (
        effective_pressure_part,
        error_budget,
        longer_waves_part,
        patch_form_part,
        patches_to_halve,
        thin_gap_part,
    )
    from .evaluation import BudgetRequest
    from .leakage_changes import CoarserSolution
    from .missing_waves import continuation_part
    from .plastic_law import plastic_law_part
    from .sources import MODEL_PARTS, SOURCES, ErrorSource
    from .wide_intervals import VAGUE, WidestInterval, counting_steps, vague_steps, widest_interval
else:
    __getattr__, __dir__ = lazy(__name__)
