"""Draw pictures of all results.

`picture(result)` draws the figure that `result.plot()` shows. The other drawing functions draw the figure of a
particular class of results, or a further figure of a run. The module `style` defines the style of all figures.
matplotlib is imported only when something is drawn.
"""

from .cell_figures import cells_figure
from .drawing import picture, shown
from .heights import heights_figure, survey_figure
from .leakage_curves import leak_test_figure, leakage_figure
from .maps import (
    contact_figure,
    cycle_figure,
    permeability_figure,
    seal_figure,
    seal_leakage_figure,
    surface_figure,
)
from .pressure_lines import pressure_figure
from .realisations import realisation_figure
from .several_runs import comparison_figure
from .style import png, rendered, write_figure
from .surface_view import view_surface
