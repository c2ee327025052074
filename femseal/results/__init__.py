"""Results out: one dataset as netCDF, tables, and files for ParaView.

`assemble` gathers the studies of a scene into `Results`; `save` and `open_results` write and read the dataset.
Pictures and pages of results are made above, in `plots` and `report`.
"""

from typing import TYPE_CHECKING

from ..base.lazy_package import load_when_used

if TYPE_CHECKING:
    from .dataset import assemble, open_results, save
    from .paraview import write_vtk
    from .results import Results
    from .run_comparison import RunComparison, compare

load_when_used(__name__)
