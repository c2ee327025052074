"""Results out: one dataset as netCDF, tables, and files for ParaView.

`assemble` gathers the studies of a scene into `Results`; `save` and `open_results` write and read the dataset.
Pictures and pages of results are made above, in `plots` and `report`.
"""

from typing import TYPE_CHECKING

from ..base.lazy_package import lazy

if TYPE_CHECKING:
    from .dataset import RunFacts, assemble, open_results, save
    from .pixel_fields import export_field, read_pixels, stored_steps
    from .results import Results
    from .run_comparison import RunComparison, compare
    from .tables import attempts_table, leakage_table, rows, summary_html, summary_text
    from .verdict import verdict_sentences, verdict_table, verdicts_in_words, verdicts_of
    from .vtk_files import write_vtk
else:
    __getattr__, __dir__ = lazy(__name__)
