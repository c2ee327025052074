"""States of a face cut into pieces, at the loads of a scene or along a ladder of nominal pressures."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ..base import Array, Mapper, Stage
from ..base.fields import PIECE_STATE, STATE, Field, declared
from ..contact import LoadState
from ..face.curves import PieceCurves, local_peaks
from ..face.piece_flow import Failed, FlowSettings, SolveCounts, attempt
from ..face.pieces import Cut, PieceState, factors
from ..flow.permeability_table import tabulated
from ..loads import LoadProgramme, LoadStep
from ..seal import RectangularSeal
from ..seal.layouts import RectangularLayout
from ..seal.tiles import face_tiles
from .deterministic import DeterministicResult
from .face_flow import FaceFlow, resolved_flow
from .face_leakage import permeabilities_of_places
from .fluid_coupling import CoupledContact
from .scene import Scene
from .two_scale import TwoScaleResult

#: Distance of the rungs of a ladder in the cube root of the pressure, over that of the highest one. ln k is nearly
#: straight in it: on four faces under a map of ± 40 % and fluids that act, leakage on loading is within 1.2 % of that
#: of states of its own, down to a hundredth of the first; with 1/16 within 2.5 %.
_RUNG = 1 / 20
#: Stops on the way down in fractions of a peak; distance of neighbouring peaks in the cube root, over that of the
#: highest one, and most of them. On the same faces leakage on unloading is within 0.7 % from peaks that leave a seal
#: open, and from those near closing within 1.2 % in the median and 15 % at worst, whatever the number of peaks.
_STOPS, _PEAK_STEP, _MOST_PEAKS = (0.8, 0.6, 0.4, 0.25, 0.12, 0.04, 0.0), 1 / 12, 6
#: Relative distance to a peak, or to the lowest or highest pressure, within which there is no rung; and to a peak
#: within which these need no state of their own: a slope between closer states is that of their errors.
_NEAR, _SAME = 0.02, 1e-3


#: Results of a whole face at the loads of a scene.
FaceResult = DeterministicResult | TwoScaleResult


@dataclass(frozen=True, eq=False)
class FacePieces:
    """Pieces of a face at every step of a load programme, NaN where a flow failed.

    k : at each pressure of the drop, along x1 and x2 (pressures, 2, steps, m1, m2) [m³].
    pressure [Pa], mean_gap [m], contact_fraction : means of the pieces (steps, m1, m2). rows : mean contact pressure of
    the rows of points (steps, n1) [Pa].
    face : leakage of the face at full resolution (steps,) [m²/s]. own : that of the pieces in their own order.
    places : leakage of each measured place, and from three on of all but each (2 places, steps) [m²/s]; None of one.
    counts : flows through pieces. failures : one line each. unsolved : steps without a gap by number, and why.
    """

    steps: LoadProgramme
    cut: Cut
    k: Array
    rows: Array
    places: Array | None
    counts: SolveCounts
    pressure: Array = declared("state_pressure", "Pa", "contact pressure of pieces, by state", PIECE_STATE)
    mean_gap: Array = declared("state_mean_gap", "m", "mean gap of pieces, by state", PIECE_STATE)
    contact_fraction: Array = declared(
        "state_contact_fraction", "1", "fraction of pieces in contact, by state", PIECE_STATE
    )
    face: Array = declared("state_leakage", "m^2/s", "leakage of the face per unit length, by state", STATE)
    own: Array = declared(
        "state_pieces_leakage", "m^2/s", "leakage of the pieces in their own order per unit length, by state", STATE
    )
    failures: tuple[str, ...] = ()
    unsolved: tuple[tuple[int, str], ...] = ()

    computed_fields: ClassVar[dict[str, Field]] = {
        "k1": Field("state_k1", "m^3", "permeability of pieces along x1, their sides closed, by state", PIECE_STATE),
        "k2": Field("state_k2", "m^3", "permeability of pieces along x2, their sides closed, by state", PIECE_STATE),
        "factor": Field("state_factor", "1", "factor on the permeabilities of pieces in a state", STATE),
    }

    @property
    def k1(self) -> Array:
        """Permeability along x1, mean over the pressures of the drop (steps, m1, m2) [m³]."""
        return np.asarray(self.k[:, 0].mean(axis=0))

    @property
    def k2(self) -> Array:
        """Permeability along x2, mean over the pressures of the drop (steps, m1, m2) [m³]."""
        return np.asarray(self.k[:, 1].mean(axis=0))

    @property
    def factor(self) -> Array:
        """Factor of every state, see `face.pieces.factors` (steps,)."""
        return factors(self.face, self.own, self.steps)


@dataclass(frozen=True, eq=False)
class _Taken:
    """What is kept of a state: its pieces, permeabilities of the face, and of its places [m³]."""

    pieces: PieceState | Failed
    face: float
    reason: str
    places: Array | None


def pieces_at_loads(scene: Scene, cut: Cut, known: FaceResult | None, mapper: Mapper) -> FacePieces:
    """The pieces at the loads of the scene, in the contact of the face as it is, with its fluid where that acts.

    known : solution of the same face; its contact is not solved again, unless its grooves wind: those are of the seal.
    """
    if scene.flow.spiral is not None:
        scene, known = replace(scene, layout=RectangularLayout()), None
    if known is None:
        return _joined(scene, cut, scene.steps, list(scene.contact_states(_take(scene, cut), mapper=mapper)))
    solve = partial(_of_fields, cut=cut, flow=scene.flow)
    found = list(mapper(Stage("pieces of the face", solve), known.gap, iter(known.contact_pressure)))
    taken = [_Taken(of_state, np.nan, reason, None) for of_state, reason in zip(found, _reasons(known), strict=True)]
    pieces = replace(_joined(scene, cut, scene.steps, taken), face=known.leakage)
    places = known.places
    if places is None:
        return pieces
    both = places.alone if places.without is None else np.concatenate([places.alone, places.without])
    return replace(pieces, places=both)


def _reasons(known: FaceResult) -> list[str]:
    """Why a step has no leakage, "" where it has."""
    reasons = []
    for step, leakage in zip(known.steps, known.leakage, strict=True):
        start = f"{step.name}: "
        texts = (text.removeprefix(start) for text in known.failures if text.startswith(start))
        reasons.append("" if np.isfinite(leakage) else next(texts, "no flow"))
    return reasons


def pieces_on_ladder(
    scene: Scene,
    cut: Cut,
    steps: LoadProgramme,
    mapper: Mapper,
    boundary: tuple[str, str] = ("periodic", "periodic"),
) -> FacePieces:
    """The pieces along a programme of nominal pressures, without fluid, the face going on by its boundary."""
    dry = replace(scene, boundary=boundary, fluid_pressure="ignored")
    return _joined(scene, cut, steps, list(dry.contact_states(_take(scene, cut), steps=steps, mapper=mapper)))


def _take(scene: Scene, cut: Cut) -> Callable[[LoadState], _Taken]:
    """What is kept of the states of a face; grooves that wind are those of the seal."""
    widths = getattr(scene.surface, "widths", ())
    return partial(_of_state, cut=cut, flow=replace(scene.flow, spiral=None), widths=widths)


def _of_state(state: LoadState, *, cut: Cut, flow: FlowSettings, widths: tuple[int, ...]) -> _Taken:
    """Cut the contact of a state into pieces, and solve the flow through the face and its places."""
    contact = state.contact
    pieces = attempt(PieceState.of, contact.gap, contact.pressure, cut, flow)
    of_places = permeabilities_of_places(contact.gap, widths, cut.spacing, flow) if widths else None
    through: FaceFlow | Failed
    if isinstance(contact, CoupledContact):
        through = contact.flow
    else:
        through = attempt(resolved_flow, contact.gap, cut.spacing, flow)
    if isinstance(through, Failed):
        return _Taken(pieces, np.nan, through.reason, of_places)
    return _Taken(pieces, through.permeability, "", of_places)


def _of_fields(gap: NDArray[Any], pressure: NDArray[Any], *, cut: Cut, flow: FlowSettings) -> PieceState | Failed:
    return attempt(PieceState.of, gap, pressure, cut, flow)


def _joined(scene: Scene, cut: Cut, steps: LoadProgramme, taken: Sequence[_Taken]) -> FacePieces:
    """Join the states, and solve the flow over the pieces in their own order."""
    pressures, shape = scene.flow.drop.pressures.size, (len(steps), *cut.shape)
    k = np.full((pressures, 2, *shape), np.nan)
    means = {name: np.full(shape, np.nan) for name in ("pressure", "mean_gap", "contact_fraction")}
    rows, own = np.full((len(steps), cut.rows[-1]), np.nan), np.full(len(steps), np.nan)
    tiles = face_tiles(scene.surface.size, cut.shape)
    counts, failures, unsolved = [], [], []
    for s, (step, state) in enumerate(zip(steps, taken, strict=True)):
        if state.reason:
            unsolved.append((s, state.reason))
        if isinstance(state.pieces, Failed):
            failures.append(f"pieces, {step.name}: {state.pieces.reason}")
            continue
        k[:, :, s], rows[s] = state.pieces.k, state.pieces.rows
        counts.append(state.pieces.counts)
        for name, values in means.items():
            values[s] = getattr(state.pieces, name)
        in_order = k[:, :, s].reshape(pressures, 2, -1)
        values = tiles.permeability(in_order[:, 0], in_order[:, 1])
        through = attempt(scene.leakage, tiles.seal, tabulated(scene.flow.drop.pressures, list(values)))
        own[s] = np.nan if isinstance(through, Failed) else through.per_length
    # leakage of a face with a permeability of 1 m³
    unit = scene.leakage(RectangularSeal(scene.surface.size, (1, 1)), 1.0).per_length
    places = None
    if taken[0].places is not None:
        places = unit * np.array([state.places for state in taken]).T
    face = unit * np.array([state.face for state in taken])
    total = SolveCounts.total(counts)
    return FacePieces(
        steps,
        cut,
        k,
        **means,
        rows=rows,
        face=face,
        own=own,
        places=places,
        counts=total,
        failures=tuple(failures),
        unsolved=tuple(unsolved),
    )


def ladder_of(paths: Array, steps: LoadProgramme, elastic: bool) -> LoadProgramme:
    """A programme of nominal pressures from which the pieces of all paths (steps, paths) [Pa] are interpolated.

    Its loading steps are equidistant in the cube root of the pressure, from the lowest to the highest of the paths;
    its peaks are among those of the paths.
    """
    peak = local_peaks(paths, steps)
    down = (paths < peak) & (not elastic)
    highest, lowest = float(paths.max()), max(float(paths.min()), 0.0)
    peaks = _chosen_peaks(peak[down])
    first = np.cbrt(lowest / highest) if highest > 0 else 0.0
    count = int(np.ceil((1 - first) / _RUNG)) + 1
    rungs = (highest * np.linspace(first, 1.0, count)[:-1] ** 3).tolist()
    kept = [*peaks]
    for end in (lowest, highest):
        if all(abs(end - q) > _SAME * q for q in kept):
            kept.append(end)
    loading = sorted([*(p for p in rungs if all(abs(p - q) > _NEAR * q for q in kept)), *kept])
    deepest = float((paths[down] / peak[down]).min()) if down.any() else 1.0
    stops = [f for n, f in enumerate(_STOPS) if n == 0 or _STOPS[n - 1] > deepest]
    unloading = [LoadStep(f * p, p) for p in peaks for f in stops]
    return LoadProgramme([*map(LoadStep, loading), *unloading])


def _chosen_peaks(peaks: Array) -> list[float]:
    """Some of the peaks, rising: the highest, the lowest, and those nearest to equal distances in the cube root."""
    apart: list[float] = []
    for peak in np.unique(peaks)[::-1].tolist():
        if not apart or peak * (1 + _NEAR) < apart[-1]:
            apart.append(peak)
    if len(apart) < 2:
        return apart
    values = np.array(apart[::-1])
    roots = np.cbrt(values / values[-1])
    count = min(int(np.ceil((1 - roots[0]) / _PEAK_STEP)) + 1, _MOST_PEAKS)
    wanted = np.linspace(roots[0], 1.0, count)
    return np.unique(values[np.abs(roots - wanted[:, None]).argmin(axis=1)]).tolist()


def along_paths(pieces: FacePieces, paths: Array, steps: LoadProgramme) -> Array:
    """Permeability of the pieces, times the factor of each state, along paths of the pressure (steps, paths) [Pa].

    Returns (pressures, 2, steps, paths, pieces) [m³].
    """
    k = (pieces.k * pieces.factor[:, None, None]).reshape(*pieces.k.shape[:3], -1)
    out = np.empty((*k.shape[:2], *paths.shape, k.shape[-1]))
    for at in np.ndindex(*k.shape[:2]):
        for n in range(k.shape[-1]):
            out[*at, :, :, n] = PieceCurves(pieces.steps, k[*at, :, n]).along(paths, steps)
    return out
