"""Windows of a face: their partition, and the flow of one window."""

from typing import TYPE_CHECKING

from ..base.lazy_package import load_when_used

if TYPE_CHECKING:
    from .partition import ContactPressure, Partition, WindowFields
    from .window_flow import Failed, FlowHistory, FlowSettings, SolveCounts, SolverCounts, attempt

load_when_used(__name__)
