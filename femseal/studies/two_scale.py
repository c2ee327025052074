"""The two-scale study: contact and flow of a whole face, and the pieces into which it is cut."""

from dataclasses import dataclass, field, replace
from functools import partial
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ..base import Array, InputError, Mapper, Shown, Stage
from ..base.fields import PIECE, PIXEL, ROW, STEP, Field, declared
from ..flow.pressure_drop import VISCOUS
from ..loads import LoadProgramme
from ..windows import FlowHistory, FlowSettings, Partition, SolveCounts, SolverCounts
from ..windows.partition import ContactPressure, WindowFields
from ..windows.window_flow import flow_history
from .deterministic import DeterministicResult, deterministic
from .face_leakage import PlaceLeakage
from .scene import Scene


@dataclass(frozen=True, repr=False)
class TwoScaleResult(Shown):
    """Contact and flow of a whole face, and of its pieces; arrays over steps, rows and columns of pieces.

    partition : the pieces. fields : deformed gap and contact pressure at every pixel.
    leakage, fluid_pressure, row_pressure and so on : of the whole face, see `DeterministicResult`.
    k1, k2 : of each piece alone with closed sides, of a gas whose law depends on it at the mean fluid pressure there.
    drop_fraction : the dissipation in a piece over that in all of them; NaN where nothing flows.
    counts : flows of pieces, solved or known without solving. solvers : number of systems by solver, of pieces and of
    the face. unsolved : steps at which the faces part, by their number, and why. failures : reasons of values that are
    NaN. warnings : reasons to doubt the result.
    """

    steps: LoadProgramme
    partition: Partition = field(repr=False)
    fields: WindowFields
    leakage: Array = declared(
        "leakage_two_scale", "m^2/s", "leakage per unit seal length, two-scale", STEP, heading="two-scale"
    )
    k1: Array = declared("piece_k1", "m^3", "permeability of pieces along x1, their sides closed", PIECE)
    k2: Array = declared("piece_k2", "m^3", "permeability of pieces along x2, their sides closed", PIECE)
    pressure: Array = declared("piece_pressure", "Pa", "contact pressure of pieces", PIECE)
    mean_gap: Array = declared("piece_mean_gap", "m", "mean gap of pieces", PIECE)
    contact_fraction: Array = declared("piece_contact_fraction", "1", "fraction of pieces in contact", PIECE)
    plastic_fraction: Array = declared("piece_plastic_fraction", "1", "fraction of pieces at the hardness", PIECE)
    drop_fraction: Array = declared(
        "piece_drop_fraction", "1", "fraction of the pressure drop in pieces, NaN without flow", PIECE
    )
    fluid_pressure: NDArray[np.float32] = declared(
        "fluid_pressure", "Pa", "fluid pressure, NaN in contact and in pockets", PIXEL
    )
    row_pressure: Array = declared("row_pressure", "Pa", "mean contact pressure of rows", ROW, repr=False)
    band_breadth: Array = declared("band_breadth", "m", "breadth of the band in contact", STEP, repr=False)
    largest_row_pressure: Array = declared(
        "largest_row_pressure", "Pa", "largest mean contact pressure of a row", STEP, repr=False
    )
    carried_pressure: Array | None = declared(
        "fluid_carried_pressure",
        "Pa",
        "mean pressure that the fluid carries of the load",
        STEP,
        default=None,
        repr=False,
    )
    entry_pressure: Array | None = declared(
        "capillary_entry_pressure",
        "Pa",
        "pressure below which the liquid does not enter the critical constriction, inf where it is closed",
        STEP,
        default=None,
    )
    places: PlaceLeakage | None = field(default=None, repr=False)
    counts: SolveCounts = field(default_factory=SolveCounts)
    failures: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    solvers: SolverCounts = field(default_factory=SolverCounts)
    equal_steps: int = 0
    unsolved: tuple[tuple[int, str], ...] = field(default=(), repr=False)

    computed_fields: ClassVar[dict[str, Field]] = {
        "gap": Field("gap", "m", "deformed gap", PIXEL),
        "contact_pressure": Field("contact_pressure", "Pa", "contact pressure", PIXEL),
    }

    @property
    def gap(self) -> NDArray[np.float32]:
        """Deformed gap (steps, n1, n2) [m]; it is read-only."""
        return self.fields.gap

    @property
    def contact_pressure(self) -> ContactPressure:
        """Contact pressure (steps, n1, n2) [Pa], used like an array."""
        return self.fields.pressure


#: What both results have by the same names.
_OF_FACE = (
    "leakage",
    "fluid_pressure",
    "row_pressure",
    "band_breadth",
    "largest_row_pressure",
    "carried_pressure",
    "entry_pressure",
    "places",
    "warnings",
    "equal_steps",
)
#: What the result has of the pieces by the same names.
_OF_PIECES = ("fields", "pressure", "mean_gap", "contact_fraction", "plastic_fraction", "drop_fraction", "unsolved")


def two_scale(
    scene: Scene, cells: tuple[int, int], *, solved: DeterministicResult | None = None, mapper: Mapper = map
) -> TwoScaleResult:
    """Solve contact and flow of the whole face, and the permeability of each of the pieces into which it is cut.

    Parameters
    ----------
    scene : the face, its load and its fluid.
    cells : number of pieces along x1 and x2.
    solved : the deterministic solution of the same scene with these cells; it is solved here unless given.
    mapper : computes a stage for many items, such as the builtin `map`; it may use several processes.

    Raises
    ------
    InputError : cells that do not suit the surface or `solved`, or as `deterministic`.
    NotConverged : a contact failed. Flows that fail are NaN, and listed in `failures`.
    """
    face = deterministic(scene, cells=cells, mapper=mapper) if solved is None else solved
    pieces = face.windows
    if pieces is None or pieces.fields.partition.cells != tuple(cells) or face.gap.shape[1:] != scene.surface.shape:
        given = "no pieces" if pieces is None else f"{pieces.fields.partition.cells} pieces"
        raise InputError("solved", f"a solution with {given}", f"one with {tuple(cells)} pieces of this face")
    flows = _flows_of_pieces(scene, pieces.fields, face.fluid_pressure, mapper)
    k1, k2 = np.array([found.k for found in flows]).reshape(*cells, 2, -1).transpose(2, 3, 0, 1)
    for s, _ in pieces.unsolved:
        k1[s] = k2[s] = np.nan
    counts = SolveCounts.total(found.counts for found in flows)
    failed = (
        f"piece {place}, {text}"
        for place, found in zip(pieces.fields.partition.places, flows, strict=True)
        for text in found.failures
    )
    return TwoScaleResult(
        steps=scene.steps,
        partition=pieces.fields.partition,
        k1=k1,
        k2=k2,
        counts=counts,
        failures=(*face.failures, *failed),
        solvers=face.solvers + counts.solvers,
        **{name: getattr(face, name) for name in _OF_FACE},
        **{name: getattr(pieces, name) for name in _OF_PIECES},
    )


def _flows_of_pieces(
    scene: Scene, fields: WindowFields, fluid_pressure: NDArray[np.float32], mapper: Mapper
) -> list[FlowHistory]:
    """Permeability of every piece along x1 and x2 (2, steps)."""
    partition, settings = fields.partition, scene.flow
    stage = Stage("flow in pieces", partial(_flow_of_piece, spacing=partition.spacing, settings=settings))
    pressures = None
    if settings.drop.law.depends_on_pressure:
        pressures = np.array([_mean_pressures(partition, p, settings.drop.inlet) for p in fluid_pressure])
    return list(
        mapper(
            stage,
            (partition.cell(fields.gap, *place) for place in partition.places),
            [None if pressures is None else pressures[:, i, j] for i, j in partition.places],
        )
    )


def _mean_pressures(partition: Partition, pressure: NDArray[np.float32], unknown: float) -> Array:
    """Mean of the fluid pressure [Pa] over each piece (m1, m2); `unknown` where there is none."""
    known = np.isfinite(pressure)
    total, count = partition.cell_means(np.where(known, pressure, 0.0)), partition.cell_means(known)
    return np.divide(total, count, out=np.full(total.shape, unknown), where=count > 0)


def _flow_of_piece(
    gaps: NDArray[np.float32], pressures: Array | None, spacing: tuple[float, float], settings: FlowSettings
) -> FlowHistory:
    """Permeability of a piece with closed sides along x1 and x2 (2, steps), at its own mean fluid pressures [Pa]."""
    law = settings.drop.law
    if pressures is not None:
        least = settings.drop.least_pressure
        gaps = np.array([law.equivalent_gap(gap, max(p, least)) for gap, p in zip(gaps, pressures, strict=True)])
        settings = replace(settings, drop=VISCOUS)
    along, across = (flow_history(gaps, spacing, axis, settings) for axis in (0, 1))
    failures = (f"x{n}, {text}" for n, found in enumerate((along, across), 1) for text in found.failures)
    return FlowHistory(np.array([[along.k, across.k]]), along.counts + across.counts, tuple(failures))


def solve_links(
    fields: WindowFields, axis: int, settings: FlowSettings, *, shift: int = 0, mapper: Mapper = map
) -> FlowHistory:
    """Solve the permeability of all links along `axis`; `shift` moves their windows by so many pixels along x2."""
    partition = fields.partition
    places = partition.links(axis)
    windows = (partition.link(fields.gap, i, j, axis, shift) for i, j in places)
    stage = Stage("flow in windows", partial(flow_history, axis=axis, settings=settings))
    # one argument is a list, so that the mapper knows the number of items
    flows = list(mapper(stage, windows, [partition.spacing] * len(places)))
    k = np.empty((settings.drop.pressures.size, len(fields.steps), partition.cells[0] - axis, partition.cells[1]))
    for (i, j), found in zip(places, flows, strict=True):
        k[:, :, i, j] = found.at_pressures
    return FlowHistory(
        at_pressures=k,
        counts=SolveCounts.total(found.counts for found in flows),
        failures=tuple(f"x{axis + 1}-link {p}, {t}" for p, f in zip(places, flows, strict=True) for t in f.failures),
    )
