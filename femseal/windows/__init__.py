"""Windows of a face: their partition, the contact of the whole face below them, contact and flow of one window."""

from typing import TYPE_CHECKING

from ..base.lazy_package import load_when_used

if TYPE_CHECKING:
    from .global_contact import GlobalState, global_states
    from .partition import ContactPressure, Partition, WindowFields
    from .window_contact import ContactHistory, contact_history, gap_error
    from .window_flow import Failed, FlowHistory, FlowSettings, SolveCounts, SolverCounts, attempt, window_dissipation

load_when_used(__name__)
