"""Design answers from a run: what pressures a seal needs in assembly and in service, and what changes them most.

`design` solves a case, or takes finished results, and gives a `Design`: Qmin and QSmin of leakage classes as EN 13555
and EN 1591-1 use them, the sealing load, sensitivities; as a data sheet, a picture and a section of the report.
"""

from .answer import Design, design
from .requirements import NeededPressure, Requirement
from .sensitivities import Sensitivity

__all__ = ["Design", "NeededPressure", "Requirement", "Sensitivity", "design"]
