"""Draw pictures of all results. No package that this one imports draws anything.

`picture(result)` draws what `result.plot()` shows. Each of the other functions draws the picture of one class, or one
more picture of a run. matplotlib is imported when something is drawn.
"""

from .cell_figures import cells_figure
from .drawing import picture, png, shown
from .heights import heights_figure, survey_figure
from .leakage_curves import leak_test_figure, leakage_figure
from .maps import (
    contact_figure,
    cycle_figure,
    permeability_figure,
    seal_figure,
    seal_leakage_figure,
)
from .several_runs import comparison_figure
