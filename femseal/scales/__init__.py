"""Parts of the two-scale method: windows of a face, their contact and flow, libraries of windows, and drawn links."""

from .column_runs import ColumnRuns, RunFlows
from .curves import CellCurves
from .dissipation import window_dissipation
from .elements import ElementFlow, WindowFlow, element_flow, face_potential, window_flow
from .gap_error import gap_error
from .global_contact import GlobalState, global_states
from .ladder import Cell, Ladder, follow
from .library import LadderLibrary, LibraryTable, WindowSource, build_ladder_library, on_ladder
from .outcome import Failed, SolveCounts, SolverCounts, attempt
from .partition import Partition
from .sampling import SAMPLERS, LinkTable, correlation_length, draw_links, draw_pressures
from .window import FlowSettings, WindowHistory, respond
from .window_fields import ContactPressure, WindowFields

__all__ = [
    "SAMPLERS",
    "Cell",
    "CellCurves",
    "ColumnRuns",
    "ContactPressure",
    "ElementFlow",
    "Failed",
    "FlowSettings",
    "GlobalState",
    "Ladder",
    "LadderLibrary",
    "LibraryTable",
    "LinkTable",
    "Partition",
    "RunFlows",
    "SolveCounts",
    "SolverCounts",
    "WindowFields",
    "WindowFlow",
    "WindowHistory",
    "WindowSource",
    "attempt",
    "build_ladder_library",
    "correlation_length",
    "draw_links",
    "draw_pressures",
    "element_flow",
    "face_potential",
    "follow",
    "gap_error",
    "global_states",
    "on_ladder",
    "respond",
    "window_dissipation",
    "window_flow",
]
