"""Results out: one dataset as netCDF, tables, pictures, and files for ParaView.

`assemble` gathers the studies of a scene into `Results`; `write_folder` writes everything there is to look at, `save`
and `open_results` the dataset alone. Libraries for files and pictures are loaded when first needed.
"""

from .folder import write_folder
from ..plots.maps import seal_figure
from ..plots.curves import cells_figure, leakage_figure
from ..report.page import write_report
from .results import Results, assemble, open_results, save
from ..plots.surface import survey_figure
from .vtk import write_vtk

__all__ = [
    "Results",
    "assemble",
    "cells_figure",
    "leakage_figure",
    "open_results",
    "save",
    "seal_figure",
    "survey_figure",
    "write_folder",
    "write_report",
    "write_vtk",
]
