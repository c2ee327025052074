"""The error budget of a leakage: what solver, pixels, filter, realisations and one measured patch may be off.

`sources.py` has the list of all sources of error, which a run and its forecast iterate: each with the versions of the
input that are solved for it (`versions.py`), and its evaluation. A budget belongs to one study of one scene:
`error_budget` gathers the estimates of its numbers (`estimates.py`), and `error_parts.py` combines all parts to one
interval. All distances are of ln(leakage): near closing, errors are factors.
"""

from typing import TYPE_CHECKING

from ..base.lazy_package import lazy

if TYPE_CHECKING:
    from .changed_models import (
        FormTolerance,
        ModelChange,
        model_changes,
        model_part,
        opposite_matters,
    )
    from .error_parts import (
        MODEL_PARTS,
        VAGUE,
        CoarserSolution,
        ErrorBudget,
        ErrorPart,
        WidestBand,
        counting_steps,
        vague_steps,
        widest_band,
    )
    from .estimates import (
        effective_pressure_part,
        error_budget,
        longer_waves_part,
        patch_form_part,
        patches_to_halve,
        thin_gap_part,
    )
    from .resolution import continuation_part
    from .sources import SOURCES, BudgetRequest, ErrorSource, budgets_of, versions_of_budget
else:
    __getattr__, __dir__ = lazy(__name__)
