"""The two-scale study: contact and flow of a whole face, and the pieces into which it is cut."""

from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from ..base import Array, InputError, Mapper, Shown, Stage
from ..base.fields import PIECE, PIXEL, ROW, STEP, declared
from ..face.contact_pressure import ContactPressure
from ..face.piece_flow import Failed, FlowSettings, SolveCounts, SolverCounts, attempt, piece_permeability
from ..face.pieces import Cut
from ..flow.pressure_drop import VISCOUS
from ..loads import LoadProgramme
from .deterministic import DeterministicResult, deterministic
from .face_leakage import PlaceLeakage
from .scene import Scene


@dataclass(frozen=True, repr=False)
class TwoScaleResult(Shown):
    """Contact and flow of a whole face, and of its pieces; arrays over steps, rows and columns of pieces.

    cut : the pieces. gap, contact_pressure : at every pixel, see `DeterministicResult`.
    leakage, fluid_pressure, row_pressure and so on : of the whole face, see `DeterministicResult`.
    k1, k2 : of each piece alone with closed sides, of a gas whose law depends on it at the mean fluid pressure there.
    drop_fraction : the dissipation in a piece over that in all of them; NaN where nothing flows.
    counts : flows of pieces, solved or known without solving. solvers : number of systems by solver, of pieces and of
    the face. unsolved : steps at which the faces part, by their number, and why. failures : reasons of values that are
    NaN. warnings : reasons to doubt the result.
    """

    steps: LoadProgramme
    cut: Cut = field(repr=False)
    gap: NDArray[np.float32] = declared("gap", "m", "deformed gap", PIXEL)
    contact_pressure: ContactPressure = declared("contact_pressure", "Pa", "contact pressure", PIXEL)
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


#: What both results have by the same names.
_OF_FACE = (
    "gap",
    "contact_pressure",
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
_OF_PIECES = ("cut", "pressure", "mean_gap", "contact_fraction", "plastic_fraction", "drop_fraction", "unsolved")


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
    pieces = face.pieces
    if pieces is None or pieces.cut.shape != tuple(cells) or face.gap.shape[1:] != scene.surface.shape:
        given = "no pieces" if pieces is None else f"{pieces.cut.shape} pieces"
        raise InputError("solved", f"a solution with {given}", f"one with {tuple(cells)} pieces of this face")
    flows = _flows_of_pieces(scene, pieces.cut, face, mapper)
    k1, k2 = np.array([found.k for found in flows]).reshape(*cells, 2, -1).transpose(2, 3, 0, 1)
    for s, _ in pieces.unsolved:
        k1[s] = k2[s] = np.nan
    counts = SolveCounts.total(found.counts for found in flows)
    failed = (
        f"piece {place}, {text}"
        for place, found in zip(np.ndindex(*cells), flows, strict=True)
        for text in found.failures
    )
    return TwoScaleResult(
        steps=scene.steps,
        k1=k1,
        k2=k2,
        counts=counts,
        failures=(*face.failures, *failed),
        solvers=face.solvers + counts.solvers,
        **{name: getattr(face, name) for name in _OF_FACE},
        **{name: getattr(pieces, name) for name in _OF_PIECES},
    )


@dataclass(frozen=True, eq=False)
class _PieceFlows:
    """Permeability of a piece along x1 and x2 (2, steps) [m³], NaN where there is no gap or the flow failed."""

    k: Array
    counts: SolveCounts
    failures: tuple[str, ...]


def _flows_of_pieces(scene: Scene, cut: Cut, face: DeterministicResult, mapper: Mapper) -> list[_PieceFlows]:
    """Permeability of every piece at every step."""
    settings = scene.flow
    stage = Stage("flow in pieces", partial(_flows_of_piece, spacing=cut.spacing, settings=settings))
    gaps = cut.pieces(face.gap)
    if not settings.drop.law.depends_on_pressure:
        return list(mapper(stage, gaps, [None] * len(gaps)))
    pressures = np.array([_mean_pressures(cut, p, settings.drop.inlet) for p in face.fluid_pressure])
    return list(mapper(stage, gaps, list(pressures.reshape(len(pressures), -1).T)))


def _mean_pressures(cut: Cut, pressure: NDArray[np.float32], unknown: float) -> Array:
    """Mean of the fluid pressure [Pa] over each piece (m1, m2); `unknown` where there is none."""
    known = np.isfinite(pressure)
    total, count = cut.sums(np.where(known, pressure, 0.0)), cut.sums(known)
    return np.divide(total, count, out=np.full(total.shape, unknown), where=count > 0)


def _flows_of_piece(
    gaps: NDArray[np.float32], pressures: Array | None, spacing: tuple[float, float], settings: FlowSettings
) -> _PieceFlows:
    """Flow through a piece with closed sides from its gaps (steps, n1, n2) [m], at its own mean pressures [Pa]."""
    law = settings.drop.law
    if pressures is not None:
        least = settings.drop.least_pressure
        gaps = np.array([law.equivalent_gap(gap, max(p, least)) for gap, p in zip(gaps, pressures, strict=True)])
        settings = replace(settings, drop=VISCOUS)
    k, counts, failures = np.full((2, len(gaps)), np.nan), [], []
    known: dict[bytes, Array] = {}
    for s in np.flatnonzero(np.isfinite(gaps).all(axis=(1, 2))):
        if (bits := gaps[s].tobytes()) in known:
            k[:, s] = known[bits]
            counts.append(SolveCounts(equal=2))
            continue
        known[bits] = k[:, s]
        for axis in (0, 1):
            flow = attempt(piece_permeability, np.asarray(gaps[s], float), spacing, axis, settings)
            if isinstance(flow, Failed):
                failures.append(f"x{axis + 1}, step {s}: {flow.reason}")
                continue
            k[axis, s] = flow.k[0]
            counts.append(flow.counts)
    return _PieceFlows(k, SolveCounts.total(counts), tuple(failures))
