"""Pictures of all results; no package below this one draws.

`picture(result)` is what `result.plot()` gives: each function below is the picture of one class, or one more picture of
a run. matplotlib is loaded when something is drawn.
"""

from .drawing import picture, png, shown
from .heights import heights_figure, survey_figure
from .leakage_curves import leak_test_figure, leakage_figure, pieces_figure
from .maps import (
    contact_figure,
    cycle_figure,
    permeability_figure,
    seal_figure,
    seal_leakage_figure,
)
from .several_runs import comparison_figure
