"""Two scales: windows of a surface, their response along a load cycle, a library of them, and draws from it."""

from .library import (
    CellCurves,
    Ladder,
    LadderLibrary,
    PlacedLibrary,
    build_ladder_library,
    build_placed_library,
)
from .partition import GlobalScale, Partition, solve_global_scale
from .response import WindowHistory, respond
from .sampling import SAMPLERS, draw_links

__all__ = [
    "SAMPLERS",
    "CellCurves",
    "GlobalScale",
    "Ladder",
    "LadderLibrary",
    "Partition",
    "PlacedLibrary",
    "WindowHistory",
    "build_ladder_library",
    "build_placed_library",
    "draw_links",
    "respond",
    "solve_global_scale",
]
