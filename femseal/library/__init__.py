"""Libraries of windows: their response along a ladder of pressures, and draws of links and columns from them."""

from typing import TYPE_CHECKING

from ..base.lazy_package import load_when_used

if TYPE_CHECKING:
    from .column_runs import ColumnRuns, RunFlows
    from .curves import WindowCurves
    from .ladder import Ladder, LibrarySummary, WindowStates, solve_ladder
    from .library import LadderLibrary, LibraryTable, WindowSource, build_ladder_library, on_ladder
    from .sampling import SAMPLERS, LinkTable, correlation_length, draw_cells, draw_links, draw_pressures

__all__ = [
    "WindowStates",
    "WindowCurves",
    "ColumnRuns",
    "Ladder",
    "LadderLibrary",
    "LibrarySummary",
    "LibraryTable",
    "LinkTable",
    "RunFlows",
    "SAMPLERS",
    "WindowSource",
    "build_ladder_library",
    "correlation_length",
    "draw_cells",
    "draw_links",
    "draw_pressures",
    "solve_ladder",
    "on_ladder",
]

load_when_used(__name__)
