"""Collect the results of a run in a dataset, and turn it into tables and files for other programs.

The function `assemble` collects the results of all studies of a run in a dataset, and `save` and `open_results` write
and read the dataset. From the dataset, all other modules of this package make tables, verdicts on leakage classes,
comparisons and files. Pictures are drawn in `plots`, and the report is made in `report`.
"""

from typing import TYPE_CHECKING

from ..base.lazy_package import lazy

if TYPE_CHECKING:
    from .attempts import attempts_table
    from .dataset import RunFacts, assemble
    from .dataset_file import open_results, save
    from .pixel_fields import export_field, read_pixels, stored_steps
    from .results import Results
    from .run_comparison import RunComparison, compare
    from .sealing_index import sealing_indices
    from .tables import leakage_table, rows, summary_html, summary_text
    from .verdict import verdicts_of
    from .verdict_paragraphs import verdict_lines
    from .verdict_text import verdict_sentences, verdict_table
    from .vtk_files import write_vtk
else:
    __getattr__, __dir__ = lazy(__name__)
