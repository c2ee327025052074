"""Estimate time and memory of the studies before a run.

Estimated times refer to one core of the machine on which the throughput was measured. The accuracy of the estimates is
documented in docs/evidence/forecast.md.
"""

from __future__ import annotations

from ..base import counted
from ..base.shared_arrays import lies_on_disk
from ..contact.workspace import KEPT_POINTS
from ..scene import Scene
from .study_type import StudyCost

#: Memory of a pixel of a stored state [byte]: gap, contact pressure and potential in single precision, and one bit that
#: says whether the contact pressure is at the hardness.
STATE_BYTES = 12.125
#: Memory of a pixel of a result [byte], which also contains the fluid pressure.
RESULT_BYTES = 16.125
#: Memory for each pixel while contact and flow of a step are solved [byte], and memory that the contact solver keeps
#: for its next solution on surfaces of up to `KEPT_POINTS`. The two numbers were measured on surfaces with 512² to
#: 4096² pixels.
_SOLUTION_BYTES, _KEPT_BYTES = 130.0, 130.0
#: Time on one core for each pixel and load step [s]: first for the contact, then for the flow through the gap. The two
#: times are fitted to the runs of docs/evidence/forecast.md.
CONTACT_SECONDS, FLOW_SECONDS = 6e-7, 5e-7
#: Mean number of times that contact and flow of a load step are solved if the fluid pressure acts on the surfaces.
_COUPLED_SOLUTIONS = 2.5
#: Mean number of times that the flow of a rarefied gas through the gap is solved.
_RAREFIED_SOLUTIONS = 4.5
#: Usual number of contact states at tabulated pressures.
TABULATED_STATES = 25.0


def state_memory(pixels: float) -> float:
    """Estimate the memory [byte] that is needed to solve contact and flow of a single load step.

    The estimate holds for the multigrid solver. If multigrid fails, the flow is solved by elimination, which needs more
    memory.
    """
    return pixels * (_SOLUTION_BYTES + (_KEPT_BYTES if pixels <= KEPT_POINTS else 0.0))


def states_memory(pixels: int, steps: int) -> float:
    """Estimate the memory of a result [byte] from its numbers of pixels and load steps; 0 for a result on disk."""
    bytes_of_field = 4.0 * pixels * steps
    return 0.0 if lies_on_disk(bytes_of_field) else RESULT_BYTES * pixels * steps


def count_pressures(scene: Scene) -> int:
    """Return the number of fluid pressures at which the permeabilities of cells are needed.

    If the flow law does not depend on the fluid pressure, one fluid pressure is sufficient.
    """
    return scene.flow.drop.pressures.size


def surface_seconds(scene: Scene, is_coupled: bool) -> float:
    """Return the expected time of contact and flow of the whole surface in one load step [s].

    is_coupled : whether the study takes the action of the fluid pressure on the surface into account.
    """
    flows = _RAREFIED_SOLUTIONS if count_pressures(scene) > 1 else 1.0
    seconds = scene.surface.heights.size * (CONTACT_SECONDS + flows * FLOW_SECONDS)
    return _COUPLED_SOLUTIONS * seconds if is_coupled else seconds


def surface_cost(scene: Scene) -> StudyCost:
    """Return the expected cost of contact and flow of the whole surface in all load steps."""
    pixels, steps = scene.surface.heights.size, len(scene.steps)
    seconds = steps * surface_seconds(scene, scene.acting_fluid is not None)
    return StudyCost(seconds, states_memory(pixels, steps) + state_memory(pixels))


def surface_problems(scene: Scene) -> str:
    """Say how many contact and flow problems of the whole surface are solved, and how many unknowns they have."""
    steps, pixels = len(scene.steps), scene.surface.heights.size
    return f"{steps} contact and {counted(steps, 'flow solution')} of {pixels} unknowns"
