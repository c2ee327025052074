"""Sources of windows for drawn seals: the request they get, the supply they return, and that from a face.

That source keeps the places that windows have on the face, under the contact of the two-scale solution; those of
`ladder_windows` have any pressure.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ..base import Array, FemsealError, Indices, Mapper, Shown
from ..flow.permeability_table import tabulated
from ..library import LadderLibrary, LibraryTable, LinkTable, correlation_length
from ..seal.laid_windows import SealWindows
from ..windows import Failed, FlowHistory, Partition, SolveCounts
from .face_contact import WindowContacts, solve_windows
from .face_leakage import PlaceLeakage, place_leakage
from .run_chains import StateRuns, places_of_columns, runs_of_face
from .sampling_options import Sampling, count_face_windows
from .scene import Scene
from .seat_rows import SeatRows
from .two_scale import TwoScaleResult, solve_links

#: The tables from which links along x1 and along x2 are drawn.
Tables = tuple[LinkTable, LinkTable]


@dataclass(frozen=True)
class WindowRequest:
    """Request for windows, which a source answers with a `WindowSupply`.

    scene, partition : the face and its windows. sampling : how the seal is drawn. seal_windows : those of the seal.
    two_scale : the two-scale solution of the face, if it is known already. contact : how the contact of windows with
    places is solved, see `face_contact.solve_windows`. mapper : computes a stage for many items.
    """

    scene: Scene
    partition: Partition
    sampling: Sampling
    seal_windows: SealWindows
    two_scale: TwoScaleResult | None
    contact: str | None
    mapper: Mapper


@dataclass(frozen=True)
class TablePressures:
    """Fluid pressures [Pa] at which the permeabilities of windows are known; one where they do not depend on it.

    piecewise : how they are interpolated, see `flow.PermeabilityTable`.
    """

    pressures: tuple[float, ...]
    piecewise: bool = False

    def table(self, values: Sequence[Any], cells: tuple[Indices, Indices] | None = None) -> Any:
        """What `seal_leakage` takes, from values at each of the pressures; cells as in `PermeabilityTable`."""
        return tabulated(self.pressures, values, self.piecewise, cells)


@dataclass(frozen=True, eq=False)
class WindowSupply:
    """Windows for the links of a seal.

    library : the windows.
    tables : the tables from which links along x1 and along x2 are drawn; with bounds also those of the lower and of the
        upper bounds. There are as many of each as `at` has pressures. None with runs.
    node_rows : x1 of the rows of nodes [m]; empty if they are equidistant.
    warnings : reasons to doubt the result.
    runs : of columns of the face at every step, for the sampler "runs".
    at : fluid pressures of the tables. unsolved : steps without leakage by their number, and why.
    places : leakage by measured places, where windows have theirs.
    seat : contact of the rows across a seat that is broader than the face.
    """

    library: LadderLibrary | FaceLibrary
    tables: tuple[Tables, ...]
    node_rows: tuple[float, ...] = ()
    warnings: tuple[str, ...] = ()
    runs: tuple[StateRuns | Failed, ...] = ()
    at: TablePressures = TablePressures((0.0,))
    unsolved: tuple[tuple[int, str], ...] = ()
    seat: SeatRows | None = None
    places: PlaceLeakage | None = None


#: A source of windows: takes a request and returns the windows.
Source = Callable[[WindowRequest], WindowSupply]


@dataclass(frozen=True, repr=False)
class FaceLibrary(Shown):
    """Windows of a face at their places.

    k1, k2 : permeability of links along x1 (steps, rows, columns) and x2 (steps, rows − 1, columns) [m³]. Columns come
        in the order of the face, once for every shift of the windows along x2. None with the sampler "runs".
    curves : the windows without shift, for tables and pictures.
    contact : how the contact of the windows was solved, see `choices.CONTACTS`.
    correlation_length : number of columns over which windows are alike.
    shifts : how often the windows were moved, the unmoved ones included.
    counts : flows of windows of this library, solved or known without solving.
    failures : reasons of failed windows, one line each.
    """

    k1: Array | None = field(metadata={"unit": "m^3", "long_name": "permeability along x1"})
    k2: Array | None = field(metadata={"unit": "m^3", "long_name": "permeability along x2"})
    curves: LibraryTable
    contact: str
    correlation_length: float
    shifts: int
    counts: SolveCounts = field(default_factory=SolveCounts)
    failures: tuple[str, ...] = ()

    @property
    def size(self) -> int:
        """Number of windows of links along x1."""
        return len(self.curves.k) * self.shifts

    @property
    def independent(self) -> int:
        """Number of windows that do not overlap: those of the face without shift."""
        return len(self.curves.k)


#: Length of runs of columns in correlation lengths; a run has at most all columns of the face. Where runs meet, the
#: channels of the face are cut. Measured on circular milling marks with ten columns: 0.83 to 0.95 of the leakage with
#: runs of ten, 0.36 to 0.87 with runs of two.
RUN_LENGTHS = 10


def windows_in_place(wanted: WindowRequest) -> WindowSupply:
    """Take all windows of the face at their places; if more are wanted, move them along it by fractions of a window.

    The sampler "runs" takes runs of their columns instead of links.

    Raises FemsealError: every column has a failed window.
    """
    scene, partition, two_scale, mapper = wanted.scene, wanted.partition, wanted.two_scale, wanted.mapper
    (m1, m2), w2, n2 = partition.cells, partition.window[1], wanted.seal_windows.draws[0][1]
    contact = two_scale or solve_windows(scene, partition.cells, wanted.contact, mapper=mapper)
    places = two_scale.places if two_scale else place_leakage(scene, contact.fields.gap, mapper)
    if wanted.sampling.sampler == "runs":
        return replace(_runs_in_place(wanted, contact), places=places)
    shifts = count_face_windows(wanted.sampling, partition) // (m1 * m2)
    moved = [n * w2 // shifts for n in range(shifts)]
    known = {}
    if two_scale is not None and two_scale.link_flows is not None:
        # counts and failures of the two-scale study are in its own result
        flows_before = enumerate(two_scale.link_flows)
        known = {(axis, 0): FlowHistory(flow.at_pressures) for axis, flow in flows_before}
    flows = [
        [known.get((axis, s)) or solve_links(contact.fields, axis, scene.flow, shift=s, mapper=mapper) for s in moved]
        for axis in (0, 1)
    ]
    # (pressures, steps, rows, columns)
    every_k1, every_k2 = _without_failed(*(np.concatenate([f.at_pressures for f in along], axis=3) for along in flows))
    k1, k2 = every_k1[0], every_k2[0]
    length = float(np.mean([correlation_length(k1[:, :, n * m2 : (n + 1) * m2]) for n in range(shifts)]))
    every = flows[0] + flows[1]
    library = FaceLibrary(
        k1=k1,
        k2=k2,
        curves=_curves(contact, flows[0][0].k, scene),
        contact=contact.contact,
        correlation_length=length,
        shifts=shifts,
        counts=SolveCounts.total(f.counts for f in every),
        # failures of the two-scale study are in its own result
        failures=(() if two_scale else contact.failures) + tuple(text for f in every for text in f.failures),
    )
    of_cell = np.tile(places_of_columns(scene, partition), shifts) if places is not None else None
    run = min(RUN_LENGTHS * length, float(m2))

    def table(k: Array) -> LinkTable:
        path = np.repeat(np.arange(k.shape[1])[:, None], n2, axis=1)
        return LinkTable(k, path, scene.steps, run, length, place=of_cell)

    tables = tuple((table(along), table(across)) for along, across in zip(every_k1, every_k2, strict=True))
    along, across = tables[0]
    tables = ((replace(along, pressure=_moved_along(contact.pressure, shifts)), across), *tables[1:])
    node_rows = contact.fields.partition.node_rows
    return WindowSupply(
        library,
        tables,
        node_rows,
        () if two_scale else contact.warnings,
        at=TablePressures(tuple(scene.flow.drop.pressures)),
        unsolved=contact.unsolved,
        places=places,
    )


def _runs_in_place(wanted: WindowRequest, contact: TwoScaleResult | WindowContacts) -> WindowSupply:
    """Runs of columns of the face, for the sampler "runs", with their windows as a library."""
    known = contact is wanted.two_scale
    runs = runs_of_face(contact.fields, wanted.seal_windows.draws[0][1], wanted.scene.flow.drop, mapper=wanted.mapper)
    missing = np.full(wanted.partition.cells, np.nan)
    unsolved = dict(contact.unsolved)
    runs = [Failed(unsolved[s]) if s in unsolved else state for s, state in enumerate(runs)]
    k = np.array([state.k if isinstance(state, StateRuns) else missing for state in runs])
    solved = k[np.isfinite(k[:, 0, 0])]
    library = FaceLibrary(
        k1=None,
        k2=None,
        curves=_curves(contact, k, wanted.scene),
        contact=contact.contact,
        correlation_length=correlation_length(solved) if len(solved) else 1.0,
        shifts=1,
        failures=() if known else contact.failures,
    )
    node_rows = contact.fields.partition.node_rows
    return WindowSupply(library, (), node_rows, () if known else contact.warnings, tuple(runs))


def _curves(contact: TwoScaleResult | WindowContacts, k: Array, scene: Scene) -> LibraryTable:
    """The windows of a face at their steps, with the number of their place where there are several."""
    partition = contact.fields.partition
    of_column = places_of_columns(scene, partition)
    return LibraryTable(
        steps=contact.fields.steps,
        pressure=_each_window(contact.pressure),
        k=_each_window(k),
        mean_gap=_each_window(contact.mean_gap),
        contact_fraction=_each_window(contact.contact_fraction),
        place=np.tile(of_column + 1, partition.cells[0]) if of_column.any() else None,
    )


def _moved_along(pressure: Array, shifts: int) -> Array:
    """Contact pressure of the windows of all shifts, from (steps, rows, columns) without one; between them linear."""
    following = np.roll(pressure, -1, axis=2)
    parts = (n / shifts for n in range(shifts))
    return np.concatenate([(1 - part) * pressure + part * following for part in parts], axis=2)


def _each_window(values: Array) -> Array:
    """Arrange numbers of windows at their places (steps, rows, columns) as (windows, steps)."""
    return values.reshape(len(values), -1).T


def _without_failed(k1: Array, k2: Array) -> tuple[Array, Array]:
    """Replace each column in which a window failed by the next column without failure."""
    good = np.isfinite(k1).all(axis=(0, 1, 2)) & np.isfinite(k2).all(axis=(0, 1, 2))
    if not good.any():
        raise FemsealError("library: every column of windows has a failed window")
    columns = np.flatnonzero(good)
    taken = columns[np.searchsorted(columns, np.arange(good.size)) % columns.size]
    return k1[..., taken], k2[..., taken]
