"""Estimate the error of a leakage, source by source: solver, pixels, filter, realisations, measured patch and model.

`sources.py` lists all error sources, both for a run and for the forecast of its cost. Each error source names the
modified versions of the input (`study_input.py`) that must be solved (`versions.py`), and estimates its error from
their leakages, which `evaluation.py` solves. `budgets.py` makes one error budget for the leakage of each study, and
`error_parts.py` combines all error sources into one interval.

`estimates.py`, `pixel_size.py`, `missing_waves.py` and `patch_errors.py` estimate the numerical errors and the error of
a patch. `neglected_effects.py`, `plastic_law.py` and `changed_models.py` estimate the errors of the model.
`leakage_changes.py` turns the difference between the leakages of two solutions into an error source. All errors are
expressed on the logarithmic scale, as distances from ln(leakage), because the uncertainty of the leakage near closing
is a factor rather than a difference.
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
    from .estimates import error_budget
    from .evaluation import BudgetRequest
    from .leakage_changes import CoarserSolution
    from .missing_waves import continuation_part
    from .neglected_effects import (
        effective_pressure_part,
        longer_waves_part,
        patch_form_part,
        thin_gap_part,
    )
    from .patch_errors import patches_to_halve
    from .plastic_law import plastic_law_part
    from .sources import MODEL_PARTS, SOURCES, ErrorSource
    from .wide_intervals import VAGUE, WidestInterval, counting_steps, vague_steps, widest_interval
else:
    __getattr__, __dir__ = lazy(__name__)
