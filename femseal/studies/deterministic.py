"""Contact and flow of a whole face at full resolution."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ..base import Array, Mapper, Shown
from ..base.fields import PIXEL, ROW, STEP, declared
from ..base.shared_array import lies_on_disk, one_at_a_time
from ..contact.workspace import KEPT_POINTS
from ..face.contact_pressure import ContactPressure
from ..face.piece_flow import SolverCounts
from ..face.pieces import Cut
from ..loads import LoadProgramme
from .face_contact import PieceContacts, band_breadth, solve_face
from .face_leakage import PlaceLeakage, first_equal, place_leakage, repeated
from .scene import Scene, scene_warnings

#: Memory that a pixel of a result takes at every step [byte]: gap and fluid pressure, and the contact pressure where
#: there is contact, which is a fourth of the face at high loads.
STEP_BYTES = 4.0 + 4.0 + 1.125
#: Memory that contact and flow of a step take for each pixel, and what the contact of smaller faces keeps for its next
#: [byte]. Measured on 512² to 4096² pixels.
_STATE_BYTES, _KEPT_BYTES = 130.0, 130.0


@dataclass(frozen=True, repr=False)
class DeterministicResult(Shown):
    """Contact and flow of a whole face on its own pixels; arrays over the steps.

    gap, contact_pressure, fluid_pressure : at every pixel and step, in single precision; the contact pressure is kept
    where there is contact, see `ContactPressure`. The fluid pressure is NaN in contact and in pockets.
    places : leakage by measured places, None of one.
    residual : largest residual of the contacts. failures : steps whose flow failed; their leakage is NaN. warnings :
    reasons to doubt the result. solvers : number of systems by solver. pieces : of the face, for `two_scale`; None
    unless asked for. equal_steps : number of steps that are an earlier one again, solved once.
    """

    steps: LoadProgramme
    leakage: Array = declared(
        "leakage_deterministic", "m^2/s", "leakage per unit seal length, deterministic", STEP, heading="deterministic"
    )
    contact_fraction: Array = declared(
        "contact_fraction_deterministic", "1", "fraction in contact, deterministic", STEP
    )
    plastic_fraction: Array = declared(
        "plastic_fraction_deterministic", "1", "fraction at the hardness, deterministic", STEP
    )
    mean_gap: Array = declared("mean_gap_deterministic", "m", "mean gap, deterministic", STEP)
    row_pressure: Array = declared("row_pressure", "Pa", "mean contact pressure of rows", ROW, repr=False)
    band_breadth: Array = declared("band_breadth", "m", "breadth of the band in contact", STEP)
    largest_row_pressure: Array = declared("largest_row_pressure", "Pa", "largest mean contact pressure of a row", STEP)
    gap: NDArray[np.float32] = declared("gap_deterministic", "m", "deformed gap, deterministic", PIXEL)
    contact_pressure: ContactPressure = declared(
        "contact_pressure_deterministic", "Pa", "contact pressure, deterministic", PIXEL
    )
    fluid_pressure: NDArray[np.float32] = declared(
        "fluid_pressure_deterministic",
        "Pa",
        "fluid pressure, deterministic, NaN in contact and in pockets",
        PIXEL,
    )
    carried_pressure: Array | None = declared(
        "fluid_carried_pressure", "Pa", "mean pressure that the fluid carries of the load", STEP, default=None
    )
    entry_pressure: Array | None = declared(
        "capillary_entry_pressure",
        "Pa",
        "pressure below which the liquid does not enter the critical constriction, inf where it is closed",
        STEP,
        default=None,
    )
    places: PlaceLeakage | None = field(default=None, repr=False)
    residual: float = 0.0
    failures: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    solvers: SolverCounts = field(default_factory=SolverCounts)
    pieces: PieceContacts | None = field(default=None, repr=False)
    equal_steps: int = 0


def deterministic(scene: Scene, *, cells: tuple[int, int] | None = None, mapper: Mapper = map) -> DeterministicResult:
    """Solve contact and flow of the whole face at full resolution, at every step of the load programme.

    Parameters
    ----------
    scene : the face, its load and its fluid.
    cells : number of pieces along x1 and x2 into which the face is cut besides, so that `two_scale` need not solve
        it again; None for none.
    mapper : computes a stage for many items, such as the builtin `map`; it may use several processes.

    Raises
    ------
    InputError : a spiral lay that does not suit the face, see `Scene.check_spiral`.
    NotConverged : a contact failed. A flow that fails is NaN, and listed in `failures`.
    """
    scene.check_spiral()
    surface = scene.surface
    cut = None if cells is None else Cut.of(surface, cells)
    face = solve_face(scene, cut, memory=state_memory(surface.heights.size), mapper=mapper)
    through, gap, states = face.through, face.gap, face.states
    contact_fraction, plastic_fraction, mean_gap, residual, carried = np.array([state.facts for state in states]).T
    rows, first = np.array([state.rows for state in states]), first_equal(gap, scene.steps)
    return DeterministicResult(
        steps=scene.steps,
        leakage=through.leakage,
        contact_fraction=contact_fraction,
        plastic_fraction=plastic_fraction,
        mean_gap=mean_gap,
        row_pressure=rows,
        band_breadth=band_breadth(rows, surface.spacing[0]),
        largest_row_pressure=rows.max(axis=1),
        gap=gap,
        contact_pressure=ContactPressure([state.in_contact for state in states]),
        fluid_pressure=through.fluid_pressure,
        carried_pressure=carried,
        entry_pressure=scene.entry_pressures(one_at_a_time(gap)),
        places=place_leakage(scene, gap, mapper),
        residual=float(residual.max()),
        failures=through.failures,
        warnings=scene_warnings(scene),
        solvers=through.solvers(first),
        pieces=None if cut is None else PieceContacts.of(cut, states, scene.acting_fluid is not None),
        equal_steps=repeated(first),
    )


def state_memory(pixels: float) -> float:
    """Memory that contact and flow of one step take [byte]; elimination, where multigrid fails, may take more."""
    return pixels * (_STATE_BYTES + (_KEPT_BYTES if pixels <= KEPT_POINTS else 0.0))


def states_memory(pixels: int, steps: int, each: float = STEP_BYTES) -> float:
    """Memory that so many steps take, `each` of them for a pixel [byte]: none where they lie on disk."""
    return 0.0 if lies_on_disk(4.0 * pixels * steps) else each * pixels * steps
