"""Write the results of a run for the user: a folder of files, and a report on one self-contained page."""

from typing import TYPE_CHECKING

from ..base.lazy_package import lazy

if TYPE_CHECKING:
    from .folder import write_again, write_folder
    from .page import write_report
    from .pictures import write_pictures
else:
    __getattr__, __dir__ = lazy(__name__)
