"""Sources of windows for drawn seals: the request they get, and the supply they return."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

from ..base.arrays import Array
from ..base.stage import Mapper
from ..base.text import Shown
from ..flow.permeability_table import tabulated
from ..library import LadderLibrary, LibraryTable, LinkTable
from ..seal.laid_windows import SealWindows
from ..windows import Failed, Partition, SolveCounts
from .place_leakage import PlaceLeakage
from .run_chains import StateRuns
from .sampling_options import Sampling
from .scene import Scene
from .seat_rows import SeatRows
from .two_scale import TwoScaleResult

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

    def table(self, values: Sequence[Any]) -> Any:
        """What `seal_leakage` takes, from the permeabilities at each of the pressures."""
        return tabulated(self.pressures, values, self.piecewise)


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
