"""Libraries of windows: their response along a ladder of pressures, and draws of links and columns from them."""

from .column_runs import ColumnRuns, RunFlows
from .curves import CellCurves
from .ladder import Cell, Ladder, follow
from .library import LadderLibrary, LibraryTable, WindowSource, build_ladder_library, on_ladder
from .sampling import SAMPLERS, LinkTable, correlation_length, draw_links, draw_pressures

__all__ = [
    "Cell",
    "CellCurves",
    "ColumnRuns",
    "Ladder",
    "LadderLibrary",
    "LibraryTable",
    "LinkTable",
    "RunFlows",
    "SAMPLERS",
    "WindowSource",
    "build_ladder_library",
    "correlation_length",
    "draw_links",
    "draw_pressures",
    "follow",
    "on_ladder",
]
