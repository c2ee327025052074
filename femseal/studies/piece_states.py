"""States of a face cut into pieces along a ladder of nominal pressures, and leakage of its measured places."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import ClassVar

import numpy as np

from ..base import Array, Floats, Mapper, Pair, Shape, Shown
from ..base.fields import PIECE, PLACE, STATE, STEP, Field, declared
from ..contact import LoadState
from ..face.curves import PieceCurves, local_peaks
from ..face.flow_concentration import blocks_of_one_wave, participation_number
from ..face.piece_flow import (
    FaceFlow,
    Failed,
    FlowSettings,
    SolveCounts,
    attempt,
    drop_fractions,
    flow_sides,
    permeability_along_x2,
    resolved_flow,
)
from ..face.pieces import Cut, PieceState, factors
from ..loads import LoadProgramme, LoadStep, least_counted
from ..topography.patches import divided
from .cells_in_order import cells_in_order, cells_permeability_along_x2
from .scene import Scene

#: Places from which on their scatter tells how far the leakage of more of them may lie.
FEWEST = 3
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


@dataclass(frozen=True, repr=False)
class PlaceLeakage(Shown):
    """Leakage by places, NaN where the flow failed.

    kept : of each place by itself, continued periodically, and from three on of all but each, side by side
        (2 places, steps) [m²/s].
    """

    kept: Array = field(metadata={"unit": "m^2/s"})

    computed_fields: ClassVar[dict[str, Field]] = {
        "alone": Field(
            "leakage_of_places", "m^2/s", "leakage per unit seal length, of each place alone", PLACE
        ),
        "without": Field(
            "leakage_without_place",
            "m^2/s",
            "leakage per unit seal length, of all places but one",
            PLACE,
        ),
        "scatter": Field(
            "place_scatter",
            "1",
            "standard deviation of the leakage of single places over its mean",
            STEP,
            "places ± [%]",
        ),
    }

    @property
    def alone(self) -> Array:
        """Leakage of each place by itself (places, steps)."""
        return self.kept if self.without is None else self.kept[: len(self.without)]

    @property
    def without(self) -> Array | None:
        """Leakage of all places but each (places, steps); None of two."""
        places = len(self.kept) // 2
        return self.kept[places:] if places >= FEWEST else None

    @property
    def relative(self) -> Array:
        """Leakage of each place over that of their mean (places,), mean over the loads that count; 0 if none leaks."""
        mean = self.alone.mean(axis=0)
        counts = mean > least_counted(mean)
        return (self.alone[:, counts] / mean[counts]).sum(axis=1) / max(1, counts.sum())

    @property
    def scatter(self) -> Array:
        """Standard deviation of the leakage of single places over its mean (steps,); NaN where none leaks."""
        mean = self.alone.mean(axis=0)
        return np.divide(
            self.alone.std(axis=0, ddof=1), mean, out=np.full(mean.shape, np.nan), where=mean > 0
        )


def permeabilities_of_places(
    widths: tuple[int, ...], spacing: Pair, settings: FlowSettings, gap: Floats
) -> Array:
    """Permeability of each place, and from three on of all but each (2 places,) [m³]; NaN where the flow failed.

    gap : of all places beside each other (n1, n2) [m]. widths : of each, in points.
    """
    pieces = divided(gap, widths)
    chosen = [[piece] for piece in pieces]
    if len(pieces) >= FEWEST:
        chosen += [[*pieces[:n], *pieces[n + 1 :]] for n in range(len(pieces))]
    gaps = (np.concatenate(some, axis=1) for some in chosen)
    return np.array([attempt(resolved_flow, gap, spacing, settings).permeability for gap in gaps])


@dataclass(frozen=True, eq=False)
class FacePieces:
    """Pieces of a face at every step of a load programme, NaN where a flow failed.

    k : at each pressure of the drop, along x1 and x2 (pressures, 2, steps, m1, m2) [m³].
    pressure [Pa], mean_gap [m], contact_fraction, plastic_fraction : means of the pieces (steps, m1, m2).
    drop_fraction : the dissipation in a piece over that in all of them; NaN where nothing flows. rows : mean contact
    pressure of the rows of points (steps, n1) [Pa].
    face : leakage of the face at full resolution (steps,) [m²/s]. own : that of the pieces in their own order.
    surface_k2, cells_k2 : permeability along x2 of the whole surface and of the cells in their own order (steps,) [m³],
    means over the measured patches; NaN where cells stay in order, which needs neither.
    places : leakage by measured places; None of one.
    carriers : number of blocks that effectively carry the flow through the whole surface (steps,), see
    `participation_number`. strip_scatter : of its four strips (steps,), see `face.flow_concentration.strip_scatter`;
    NaN where cells are put together at random, which does not need it. Both are NaN where nothing flows.
    counts : flows through pieces. failures : one line each. unsolved : steps without leakage by number, and why.
    """

    steps: LoadProgramme
    cut: Cut
    k: Array
    rows: Array
    places: PlaceLeakage | None
    counts: SolveCounts
    pressure: Array = declared("piece_pressure", "Pa", "contact pressure of pieces", PIECE)
    mean_gap: Array = declared("piece_mean_gap", "m", "mean gap of pieces", PIECE)
    contact_fraction: Array = declared(
        "piece_contact_fraction", "1", "fraction of pieces in contact", PIECE
    )
    plastic_fraction: Array = declared(
        "piece_plastic_fraction", "1", "fraction of pieces at the hardness", PIECE
    )
    drop_fraction: Array = declared(
        "piece_drop_fraction",
        "1",
        "fraction of the pressure drop in pieces, NaN without flow",
        PIECE,
    )
    face: Array = declared(
        "state_leakage", "m^2/s", "leakage of the face per unit length, by state", STATE
    )
    own: Array = declared(
        "state_pieces_leakage",
        "m^2/s",
        "leakage of the pieces in their own order per unit length, by state",
        STATE,
    )
    carriers: Array = declared(
        "state_flow_carriers",
        "1",
        "number of blocks of one short wave that effectively carry the flow, by state",
        STATE,
    )
    strip_scatter: Array = declared(
        "state_strip_scatter",
        "1",
        "coefficient of variation of the permeability of four strips of the face, by state",
        STATE,
    )
    surface_k2: Array = declared(
        "state_surface_k2", "m^3", "permeability of the whole surface along x2, by state", STATE
    )
    cells_k2: Array = declared(
        "state_cells_k2",
        "m^3",
        "permeability along x2 of the cells in their own order, by state",
        STATE,
    )
    failures: tuple[str, ...] = ()
    unsolved: tuple[tuple[int, str], ...] = ()

    computed_fields: ClassVar[dict[str, Field]] = {
        "k1": Field(
            "piece_k1", "m^3", "permeability of pieces along x1, their sides closed", PIECE
        ),
        "k2": Field(
            "piece_k2", "m^3", "permeability of pieces along x2, their sides closed", PIECE
        ),
        "factor": Field(
            "state_factor", "1", "correction factor on k1 of the cells in a state", STATE
        ),
        "factor_k2": Field(
            "state_factor_k2", "1", "correction factor on k2 of the cells in a state", STATE
        ),
    }

    @property
    def k1(self) -> Array:
        """Permeability along x1, mean over the pressures of the drop (steps, m1, m2) [m³]."""
        return self.k[:, 0].mean(axis=0)

    @property
    def k2(self) -> Array:
        """Permeability along x2, mean over the pressures of the drop (steps, m1, m2) [m³]."""
        return self.k[:, 1].mean(axis=0)

    @property
    def factor(self) -> Array:
        """Correction factor of k1 in every state, see `face.pieces.factors` (steps,)."""
        return factors(self.face, self.own, self.steps)

    @property
    def factor_k2(self) -> Array:
        """Correction factor of k2 in every state (steps,), 1 where the flow along x2 was not solved."""
        return factors(self.surface_k2, self.cells_k2, self.steps)

    @property
    def corrected_k(self) -> Array:
        """Permeabilities `k`, each times the correction factor of its axis and state."""
        both = np.stack([self.factor, self.factor_k2])  # (axis, step)
        return self.k * both[:, :, None, None]


def pieces_on_ladder(
    scene: Scene,
    cut: Cut,
    steps: LoadProgramme,
    mapper: Mapper,
    boundary: tuple[str, str] = ("periodic", "periodic"),
) -> FacePieces:
    """The pieces along a programme of nominal pressures, without fluid, the face going on by its boundary."""
    dry = scene.dry(boundary=boundary)
    # flow along x1 is periodic along x2 in every study
    continues = "periodic" if boundary[0] == "periodic" else "free", "periodic"
    # grooves that wind are those of the seal
    take = partial(
        _of_state,
        cut=cut,
        flow=replace(scene.flow, spiral=None),
        widths=scene.surface.widths,
        blocks=blocks_of_one_wave(scene.surface),
        boundary=continues,
    )
    states = list(dry.contact_states(take, steps=steps, mapper=mapper))
    return joined(scene, cut, steps, states, continues)


def _of_state(
    state: LoadState,
    *,
    cut: Cut,
    flow: FlowSettings,
    widths: tuple[int, ...],
    boundary: tuple[str, str],
    blocks: Shape,
) -> PieceState:
    """Cut the contact of a state into pieces, and solve the flow through the face and its places."""
    gap = state.contact.gap
    pieces = PieceState.of(gap, state.contact.pressure, cut, flow, boundary=boundary)
    several = len(widths) > 1
    of_places = permeabilities_of_places(widths, cut.spacing, flow, gap) if several else None
    through = attempt(resolved_flow, gap, cut.spacing, flow, flow_sides(boundary[1]))
    carriers = np.nan
    if isinstance(through, FaceFlow):
        dissipation = drop_fractions(gap, cut.spacing, through.potential, flow)
        carriers = participation_number(dissipation, blocks)
    along_x2 = attempt(
        permeability_along_x2, gap, widths, cut.spacing, flow, flow_sides(boundary[0])
    )
    failures = pieces.failures
    if isinstance(along_x2, Failed):
        failures = (*failures, f"whole surface, x2: {along_x2.reason}")
    return replace(
        pieces,
        face=through.permeability,
        surface_k2=np.nan if isinstance(along_x2, Failed) else along_x2,
        places=of_places,
        failures=failures,
        failed=getattr(through, "reason", ""),
        carriers=carriers,
    )


def joined(
    scene: Scene,
    cut: Cut,
    steps: LoadProgramme,
    taken: Sequence[PieceState],
    boundary: tuple[str, str] = ("free", "periodic"),
) -> FacePieces:
    """Join the states, and solve the flow over the pieces in their own order.

    boundary : how the surface continues; the flow along x2 is solved in states whose whole surface has one.
    """
    k = np.stack([state.k for state in taken], axis=2)
    own, cells_k2, failures = np.full(len(steps), np.nan), np.full(len(steps), np.nan), []
    for s, (step, state) in enumerate(zip(steps, taken, strict=True)):
        failures += [f"{step.name}, {text}" for text in state.failures]
        if not np.isfinite(k[:, :, s]).all():
            continue
        own[s] = cells_in_order(scene, scene.surface.size, k[:, :, s], boundary[1]).per_length
        if np.isfinite(state.surface_k2):
            cells_k2[s] = cells_permeability_along_x2(scene, cut, k[:, :, s], boundary[0])
    unit = scene.unit_leakage
    places = None
    if taken[0].places is not None:
        places = PlaceLeakage(unit * np.array([state.places for state in taken]).T)
    means = (
        "pressure",
        "mean_gap",
        "contact_fraction",
        "plastic_fraction",
        "drop_fraction",
        "rows",
        "carriers",
        "surface_k2",
    )
    return FacePieces(
        steps,
        cut,
        k,
        **{name: np.array([getattr(state, name) for state in taken]) for name in means},
        face=unit * np.array([state.face for state in taken]),
        own=own,
        cells_k2=cells_k2,
        places=places,
        strip_scatter=np.full(len(steps), np.nan),
        counts=SolveCounts.total(state.counts for state in taken),
        failures=tuple(failures),
        unsolved=tuple((s, state.failed) for s, state in enumerate(taken) if state.failed),
    )


def ladder_of(paths: Array, steps: LoadProgramme, elastic: bool, apart: int = 1) -> LoadProgramme:
    """A programme of nominal pressures from which the pieces of all paths (steps, paths) [Pa] are interpolated.

    Its loading steps are equidistant in the cube root of the pressure, from the lowest to the highest of the paths;
    its peaks are among those of the paths. apart : how many times as far apart as usual rungs and peaks are.
    """
    peak = local_peaks(paths, steps)
    down = (paths < peak) & (not elastic)
    highest = float(paths.max())
    lowest = max(float(paths.min()), 0.0)
    peaks = _chosen_peaks(peak[down], apart)
    first = np.cbrt(lowest / highest) if highest > 0 else 0.0
    count = int(np.ceil((1 - first) / (apart * _RUNG))) + 1
    kept = np.array(peaks)
    for end in (lowest, highest):
        if (np.abs(end - kept) > _SAME * kept).all():
            kept = np.append(kept, end)
    rungs = highest * np.linspace(first, 1.0, count)[:-1, None] ** 3
    apart_from = (np.abs(rungs - kept) > _NEAR * kept).all(axis=1)
    loading = np.union1d(rungs[apart_from], kept).tolist()
    deepest = (paths[down] / peak[down]).min(initial=1.0)
    stops = _STOPS[: sum(f > deepest for f in _STOPS) + 1]
    unloading = [LoadStep(f * p, p) for p in peaks for f in stops]
    return LoadProgramme([*map(LoadStep, loading), *unloading])


def _chosen_peaks(peaks: Array, times: int) -> list[float]:
    """Some of the peaks, rising: the highest, the lowest, and those nearest to equal distances in the cube root."""
    apart: list[float] = []
    for peak in np.unique(peaks)[::-1].tolist():
        if not apart or peak * (1 + _NEAR) < apart[-1]:
            apart.append(peak)
    if len(apart) < 2:
        return apart
    values = np.array(apart[::-1])
    roots = np.cbrt(values / values[-1])
    count = min(int(np.ceil((1 - roots[0]) / (times * _PEAK_STEP))) + 1, _MOST_PEAKS // times)
    wanted = np.linspace(roots[0], 1.0, count)
    return np.unique(values[np.abs(roots - wanted[:, None]).argmin(axis=1)]).tolist()


def along_paths(pieces: FacePieces, paths: Array, steps: LoadProgramme) -> Array:
    """Permeability of the cells, times the factors of each state, along paths of the pressure (steps, paths) [Pa].

    Returns (pressures, 2, steps, paths, pieces) [m³].
    """
    k = pieces.corrected_k.reshape(*pieces.k.shape[:3], -1)
    out = np.empty((*k.shape[:2], *paths.shape, k.shape[-1]))
    for at in np.ndindex(*k.shape[:2]):
        for n in range(k.shape[-1]):
            out[*at, :, :, n] = PieceCurves(pieces.steps, k[*at, :, n]).along(paths, steps)
    return out
