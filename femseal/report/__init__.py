"""Output of a run for its user: the folder of all files, and one self-contained page."""

from .folder import write_again, write_folder
from .page import write_report
from .pdf import write_pdf

__all__ = ["write_again", "write_folder", "write_pdf", "write_report"]
