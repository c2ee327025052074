"""What is asked of a source of windows for a drawn seal, and what it gives."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from ..base.stage import Mapper
from ..base.text import Shown
from ..scales import LadderLibrary, LibraryTable, LinkTable, Partition, SolveCounts
from .sampling_options import Sampling
from .scene import Array, Scene
from .two_scale import TwoScaleResult

#: From which links along x1 and x2 are drawn.
Tables = tuple[LinkTable, LinkTable]


@dataclass(frozen=True)
class Wanted:
    """What links are wanted for: windows of a face, a seal of so many, and what is known of the face already."""

    scene: Scene
    partition: Partition
    sampling: Sampling
    seal: tuple[int, int]
    two_scale: TwoScaleResult | None
    mapper: Mapper


@dataclass(frozen=True, eq=False)
class WindowSupply:
    """Windows for the links of a seal.

    library : where they come from.
    tables : what links are drawn from, along x1 and x2; with bounds followed by those of the lower and of the upper
        ones.
    node_rows : x1 of the rows of nodes [m]; none where they are equidistant.
    warnings : why the result may be far from the truth.
    """

    library: LadderLibrary | PlacedLibrary
    tables: tuple[Tables, ...]
    node_rows: tuple[float, ...] = ()
    warnings: tuple[str, ...] = ()


#: Finds or solves the windows that are wanted.
Source = Callable[[Wanted], WindowSupply]


@dataclass(frozen=True, repr=False)
class PlacedLibrary(Shown):
    """Windows of a face at their places: k1 (steps, rows, columns), k2 (steps, rows − 1, columns) [m³].

    Columns come in the order of the face, then again for every `shift` of the windows along x2.
    correlation_length : number of columns over which windows are alike. counts : flows of windows that were solved for
    this library, or known without.
    """

    k1: Array = field(metadata={"unit": "m^3", "long_name": "permeability along x1"})
    k2: Array = field(metadata={"unit": "m^3", "long_name": "permeability along x2"})
    curves: LibraryTable
    correlation_length: float
    shifts: int
    counts: SolveCounts = field(default_factory=SolveCounts)
    failures: tuple[str, ...] = ()

    @property
    def size(self) -> int:
        """Number of windows along x1."""
        return self.k1.shape[1] * self.k1.shape[2]
