"""One window solved along a ladder of pressures: loading until it is closed, unloading from peaks, rigid separation.

Loading is path independent, so steps can be added to a window at any time. Where the window closes along one axis,
bisection refines the ladder until the closing pressure is known to a tolerance. Flow in closed states is not solved.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from ..base import BLOCK, Array, InputError
from ..contact import Contact, ContactLaw, HalfSpace, solve_contact
from ..flow.pressure_drop import VISCOUS, PressureDrop
from ..windows.window_flow import Failed, FlowSettings, SolveCounts, window_permeability

#: A flow that is known to be 0.
_CLOSED = SolveCounts(closed=1)


@dataclass(frozen=True)
class Ladder:
    """States in which every window of a library is solved.

    loading : mean pressures on loading [Pa]; they rise from 0, which is first touch.
    peaks : pressures of `loading` from which windows are unloaded.
    stops : pressures on the way down in fractions of the peak; they fall to 0.
    separations : distances between the mean planes without contact pressure [m], rising.
    closing_rtol : relative tolerance of closing pressures.
    bounds : also compute a lower and an upper bound of every permeability, for a gap constant on each pixel.
    drop : of the fluid, at whose pressures permeabilities are computed.

    Raises InputError: pressures that do not rise from 0, peaks that are not among them, stops that do not fall from
    below 1 to 0, separations that do not rise.
    """

    loading: tuple[float, ...]
    peaks: tuple[float, ...] = ()
    stops: tuple[float, ...] = ()
    separations: tuple[float, ...] = ()
    closing_rtol: float = 0.05
    bounds: bool = False
    drop: PressureDrop = VISCOUS

    def __post_init__(self) -> None:
        if not self.loading or self.loading[0] != 0 or np.any(np.diff(self.loading) <= 0):
            raise InputError("loading", self.loading, "pressures that rise from 0, first touch")
        if not {*self.peaks} <= {*self.loading[1:]} or np.any(np.diff(self.peaks) <= 0):
            raise InputError("peaks", self.peaks, "rising pressures > 0 of `loading`")
        falling = np.all(np.diff(self.stops) < 0) and (not self.stops or (self.stops[0] < 1 and self.stops[-1] == 0))
        if not falling or bool(self.peaks) != bool(self.stops):
            raise InputError("stops", self.stops, "fractions that fall from below 1 to 0, where there are peaks")
        if np.any(np.diff(self.separations) <= 0):
            raise InputError("separations", self.separations, "rising distances [m]")

    @property
    def kinds(self) -> int:
        """Number of permeabilities of each state: the value, or with bounds the value and its two, at each pressure."""
        return (3 if self.bounds else 1) * self.drop.pressures.size


@dataclass(frozen=True)
class WindowStates:
    """States of a window along a ladder: one row of a library, with the states along its last axes.

    pressure : n loading pressures, those of the ladder and those found by bisection, rising from 0 (n,) [Pa].
    k : permeability on loading by kind and direction (kinds, 2, n) [m³], see `Ladder.kinds`.
    standoff, mean_gap, plastic_deformation : on loading (n,) [m]; the plastic deformation is a mean over the pixels.
    contact_fraction : fraction in contact on loading (n,).
    peaks : m pressures from which the window was unloaded (m,) [Pa].
    k_unloading : permeability on unloading (kinds, 2, m, stops) [m³]; `standoff_unloading` and the others with this
        ending are (m, stops).
    rigid : permeability at the separations (kinds, 2, separations) [m³].
    counts : flows of this cell, solved or known without solving.
    """

    pressure: Array
    k: Array
    standoff: Array
    mean_gap: Array
    plastic_deformation: Array
    contact_fraction: Array
    peaks: Array
    k_unloading: Array
    standoff_unloading: Array
    mean_gap_unloading: Array
    contact_fraction_unloading: Array
    rigid: Array
    counts: SolveCounts = field(default_factory=SolveCounts, compare=False)


@dataclass(frozen=True)
class LibrarySummary:
    """Of some windows of a library, the reasons of those that failed by their numbers, and the flows of the others."""

    failed: dict[int, str]
    counts: SolveCounts

    @classmethod
    def of(cls, outcomes: Iterable[WindowStates | Failed]) -> LibrarySummary:
        """Summary of windows, which are numbered from 0."""
        failed, counts = {}, []
        for n, window in enumerate(outcomes):
            if isinstance(window, Failed):
                failed[n] = window.reason
            else:
                counts.append(window.counts)
        return cls(failed, SolveCounts.total(counts))

    @classmethod
    def joined(cls, blocks: Iterable[LibrarySummary]) -> LibrarySummary:
        """Summary of blocks of `BLOCK` windows each."""
        every = list(blocks)
        failed = {n * BLOCK + m: reason for n, block in enumerate(every) for m, reason in block.failed.items()}
        return cls(failed, SolveCounts.total(block.counts for block in every))


def solve_ladder(
    window: Array,
    *,
    ladder: Ladder,
    half_space: HalfSpace,
    law: ContactLaw,
    rtol: float = 1e-6,
    flow: FlowSettings | None = None,
    known: WindowStates | None = None,
) -> WindowStates:
    """Solve a window along a ladder, or solve only the states of the ladder that a known cell lacks.

    The result has the states of the ladder and no others of the known cell: it is the same whatever is known.

    window : undeformed gap (n1, n2) [m].
    half_space, rtol : as in `contact.solve_contact`. law : what every point of the window can carry.
    flow : how the flow is discretised and solved.
    known : the same window along another ladder with the same stops, separations and bounds.

    Raises NotConverged: a contact or a flow failed.
    """
    work = _Window(np.asarray(window, float), half_space, law, rtol, ladder, flow)
    before = {} if known is None else dict(zip(known.pressure.tolist(), _states(known), strict=True))

    def state(pressure: float, closed: tuple[bool, bool]) -> _State:
        return before[pressure].within(closed) if pressure in before else work.loaded(pressure, closed)

    loading = _loading(ladder, state)
    peaks = {} if known is None else {p: n for n, p in enumerate(known.peaks.tolist())}
    unloadings = [
        _unloading_states(known, peaks[p]) if known is not None and p in peaks else list(work.unloaded(p, ladder.stops))
        for p in ladder.peaks
    ]
    rigid = known.rigid if known is not None else work.separated(ladder.separations)
    cell = _cell(loading, dict(zip(ladder.peaks, unloadings, strict=True)), ladder, rigid)
    return replace(cell, counts=SolveCounts.total(work.counts))


def restrict(known: WindowStates, ladder: Ladder) -> WindowStates | None:
    """The cell that `solve_ladder` gives along a ladder, from the states of a known one; None if it lacks some."""
    before = dict(zip(known.pressure.tolist(), _states(known), strict=True))
    peaks = {p: n for n, p in enumerate(known.peaks.tolist())}
    try:
        loading = _loading(ladder, lambda pressure, closed: before[pressure].within(closed))
        return _cell(loading, {p: _unloading_states(known, peaks[p]) for p in ladder.peaks}, ladder, known.rigid)
    except KeyError:
        return None


def merge(cell: WindowStates, other: WindowStates, ladder: Ladder) -> WindowStates:
    """The states of two cells of one window; both have the stops, separations and bounds of the ladder."""
    loading: dict[float, _State] = {}
    unloadings: dict[float, list[_State]] = {}
    for one in (other, cell):
        loading |= dict(zip(one.pressure.tolist(), _states(one), strict=True))
        unloadings |= {p: _unloading_states(one, m) for m, p in enumerate(one.peaks.tolist())}
    return replace(_cell(loading, unloadings, ladder, cell.rigid), counts=cell.counts)


def _loading(ladder: Ladder, state: Callable[[float, tuple[bool, bool]], _State]) -> dict[float, _State]:
    """States on loading at the steps of a ladder, and at those that bisection adds where the window closes.

    state : of a pressure, given along which axes the window is closed below it.
    """
    loading: dict[float, _State] = {}
    for p in ladder.loading:
        loading[p] = state(p, _closed_below(loading, p))
    for axis in (0, 1):
        while (middle := _between(loading, axis, ladder.closing_rtol)) is not None:
            loading[middle] = state(middle, _closed_below(loading, middle))
    return loading


def _cell(
    loading: dict[float, _State], unloadings: dict[float, list[_State]], ladder: Ladder, rigid: Array
) -> WindowStates:
    """The cell of states on loading and on unloading from peaks, both by their pressures."""
    pressure, peaks = sorted(loading), sorted(unloadings)
    states = [loading[p] for p in pressure]
    unloaded = [unloadings[p] for p in peaks]
    shape = (len(peaks), len(ladder.stops))
    means = {
        name: np.array([[getattr(s, name) for s in states] for states in unloaded]).reshape(shape)
        for name in ("standoff", "mean_gap", "contact_fraction")
    }
    down = np.array([[s.k for s in states] for states in unloaded]).reshape(*shape, ladder.kinds, 2)
    return WindowStates(
        pressure=np.array(pressure),
        k=np.array([s.k for s in states]).transpose(1, 2, 0),
        standoff=np.array([s.standoff for s in states]),
        mean_gap=np.array([s.mean_gap for s in states]),
        plastic_deformation=np.array([s.plastic_deformation for s in states]),
        contact_fraction=np.array([s.contact_fraction for s in states]),
        peaks=np.array(peaks),
        k_unloading=down.transpose(2, 3, 0, 1),
        standoff_unloading=means["standoff"],
        mean_gap_unloading=means["mean_gap"],
        contact_fraction_unloading=means["contact_fraction"],
        rigid=rigid,
    )


@dataclass(frozen=True)
class _State:
    """One state of a window: permeabilities by kind and direction (kinds, 2) [m³], and means over its pixels."""

    k: Array
    standoff: float
    mean_gap: float
    plastic_deformation: float
    contact_fraction: float

    @property
    def closed(self) -> tuple[bool, bool]:
        """Whether the window is closed along x1 and along x2: k, or with bounds its upper bound, is 0."""
        return bool(self.k[-1, 0] == 0), bool(self.k[-1, 1] == 0)

    def within(self, closed: tuple[bool, bool]) -> _State:
        """The state where it is known to be closed along axes."""
        return replace(self, k=np.where(closed, 0.0, self.k))


class _Window:
    """Solves the states of one window and counts its flows."""

    def __init__(
        self,
        gap0: Array,
        half_space: HalfSpace,
        law: ContactLaw,
        rtol: float,
        ladder: Ladder,
        flow: FlowSettings | None,
    ) -> None:
        """Prepare a window for the states of a ladder; see `solve_ladder` for the arguments."""
        self.gap0, self.half_space, self.law, self.rtol = gap0, half_space, law, rtol
        self.kinds, self.bounds = ladder.kinds, ladder.bounds
        self.flow = replace(flow or FlowSettings(), drop=ladder.drop)
        self.counts: list[SolveCounts] = []
        # plastic deformation at the peaks that have been loaded
        self._deformed: dict[float, Array | None] = dict.fromkeys(ladder.peaks)

    def loaded(self, pressure: float, closed: tuple[bool, bool]) -> _State:
        """State on loading; the plastic deformation of peaks is kept for their unloading."""
        contact = self._contact(pressure)
        if pressure in self._deformed:
            self._deformed[pressure] = contact.plastic_deformation
        return self._state(contact, closed)

    def unloaded(self, peak: float, stops: tuple[float, ...]) -> Iterator[_State]:
        """States on unloading from a peak, in the order of the stops.

        They are solved from the lowest stop upwards: a window that is closed at a stop is closed at all higher ones.
        """
        deformation = self._deformed[peak]
        if deformation is None:
            deformation = self._contact(peak).plastic_deformation
        states: list[_State] = []
        closed = (False, False)
        for fraction in reversed(stops):
            state = self._state(self._contact(fraction * peak, deformation), closed)
            closed = state.closed
            states.append(state)
        return reversed(states)

    def separated(self, separations: tuple[float, ...]) -> Array:
        """Permeabilities at the separations (kinds, 2, separations) [m³]."""
        apart = [self._permeabilities(np.maximum(self.gap0 + d, 0.0), (False, False)) for d in separations]
        return np.array(apart).reshape(len(separations), self.kinds, 2).transpose(1, 2, 0)

    def _contact(self, pressure: float, deformation: Array | None = None) -> Contact:
        return solve_contact(
            self.gap0,
            self.half_space,
            pressure=pressure,
            hardness=self.law,
            deformation=deformation,
            rtol=self.rtol,
        )

    def _state(self, contact: Contact, closed: tuple[bool, bool]) -> _State:
        k = self._permeabilities(contact.gap, closed)
        plastic = float(contact.plastic_deformation.mean())
        return _State(k, -contact.approach, float(contact.gap.mean()), plastic, contact.area_fraction)

    def _permeabilities(self, gap: Array, closed: tuple[bool, bool]) -> Array:
        """Permeabilities of a gap by kind and direction (kinds, 2) [m³]; 0 along axes known to be closed."""
        k = np.zeros((self.kinds, 2))
        for axis in (0, 1):
            if closed[axis]:
                self.counts.append(_CLOSED)
            else:
                found = window_permeability(gap, self.half_space.spacing, axis, bounds=self.bounds, settings=self.flow)
                k[:, axis] = found.k
                self.counts.append(found.counts)
        return k


def _states(cell: WindowStates) -> list[_State]:
    columns = (cell.standoff, cell.mean_gap, cell.plastic_deformation, cell.contact_fraction)
    return [_State(*values) for values in zip(np.moveaxis(cell.k, -1, 0), *columns, strict=True)]


def _unloading_states(cell: WindowStates, m: int) -> list[_State]:
    """States on unloading from peak m; their plastic deformation is that of the peak, which no cell holds again."""
    names = ("standoff_unloading", "mean_gap_unloading", "contact_fraction_unloading")
    columns = zip(*(getattr(cell, name)[m] for name in names), strict=True)
    return [_State(k, off, gap, np.nan, fraction) for k, (off, gap, fraction) in
            zip(np.moveaxis(cell.k_unloading[:, :, m], -1, 0), columns, strict=True)]  # fmt: skip


def _closed_below(loading: dict[float, _State], pressure: float) -> tuple[bool, bool]:
    below = [s.closed for p, s in loading.items() if p < pressure]
    return any(first for first, _ in below), any(second for _, second in below)


def _between(loading: dict[float, _State], axis: int, rtol: float) -> float | None:
    """Middle of the two pressures between which the window closes along `axis`; None once they are close enough."""
    pressures = sorted(loading)
    shut = [p for p in pressures if loading[p].k[0, axis] == 0]
    if not shut or shut[0] == 0:
        return None
    low, high = pressures[pressures.index(shut[0]) - 1], shut[0]
    return (low + high) / 2 if high - low > rtol * high else None
