"""Define what the result of every study contains, and the base class of results of a surface."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, ClassVar, Protocol

import numpy as np

from ..base import Array, Shown

if TYPE_CHECKING:
    from ..checks import QuickEstimate
    from ..face.cell_flow import SolveCounts
    from ..loads import LoadProgramme
    from ..scene import Scene
    from .patch_leakage import PatchLeakage
    from .patch_state import PatchState


class StudyResult(Protocol):
    """Define what the result of every study contains. Its fields for the dataset are declared by `base.fields`."""

    @property
    def method(self) -> str:
        """Name of the study."""
        ...

    @property
    def steps(self) -> LoadProgramme:
        """Load steps."""
        ...

    @property
    def leakage(self) -> Array:
        """Leakage per unit seal length [m²/s]: (steps,) or, for a study with realisations, (realisations, steps)."""
        ...

    @property
    def predicted_leakage(self) -> Array:
        """Predicted leakage per unit seal length (steps,) [m²/s], the median of the realisations if there are any."""
        ...

    @property
    def realisation_count(self) -> int | None:
        """Number of realisations; None if the study has no realisations."""
        ...

    @property
    def takes_random_cells(self) -> bool:
        """Whether the tiles of the seal take cells from anywhere on the surface."""
        ...

    @property
    def cells(self) -> Any:
        """Object with the fields of the cells; None if the surface was not divided into cells."""
        ...

    @property
    def patches(self) -> PatchLeakage | None:
        """Leakage of each measured patch; None if there is only one patch."""
        ...

    @property
    def patch_state(self) -> PatchState | None:
        """Contact states of the patch, which determine the width of the 95 % interval of a larger seal.

        None if the leakage is that of the surface itself, so that the interval is not widened.
        """
        ...

    @property
    def kind(self) -> str:
        """Kind of the calibration of the 95 % interval, see `patch_interval`; "" without a `patch_state`."""
        ...

    @property
    def surface_gap(self) -> Array:
        """Mean gap of the whole surface, or of all tiles of the seal (steps,) [m]; NaN if unknown."""
        ...

    @property
    def solve_counts(self) -> SolveCounts:
        """Number of linear systems that each solver solved."""
        ...

    @property
    def quick_estimate(self) -> QuickEstimate | None:
        """Leakage estimated from the spectrum of the surface; None if the estimate is not valid for this surface."""
        ...

    @property
    def failures(self) -> tuple[str, ...]:
        """Reasons why values of the result are NaN."""
        ...

    @property
    def warnings(self) -> tuple[str, ...]:
        """One sentence for each result that is not plausible."""
        ...

    def contact_fraction_at(self, steps: LoadProgramme) -> Array:
        """Return the fraction of the surface in contact at load steps of the result (steps,), NaN if unknown."""
        ...

    def open_leakage(self, scene: Scene) -> Array:
        """Return the leakage of a uniform gap that is equal to the mean gap (steps,) [m²/s], NaN if unknown."""
        ...


class SurfaceResult(Shown):
    """Base class of the results of studies that solve a surface, without realisations of a whole seal.

    A result is a frozen dataclass derived from this class. It defines the members of `StudyResult` that are missing
    here: method, steps, leakage, cells, patches, patch_state, quick_estimate, failures and warnings. It overrides the
    defaults of this class where it has the value.
    """

    kind: ClassVar[str] = ""
    realisation_count: ClassVar[int | None] = None
    takes_random_cells: ClassVar[bool] = False

    if TYPE_CHECKING:
        # the fields of the derived dataclasses
        @property
        def method(self) -> str:
            """Name of the study."""
            ...

        @property
        def steps(self) -> LoadProgramme:
            """Load steps."""
            ...

        @property
        def leakage(self) -> Array:
            """Leakage per unit seal length (steps,) [m²/s]."""
            ...

    @property
    def predicted_leakage(self) -> Array:
        """Leakage per unit seal length (steps,) [m²/s]."""
        return self.leakage

    @property
    def surface_gap(self) -> Array:
        """Mean gap of the surface (steps,) [m]; NaN if unknown."""
        return np.full(len(self.steps), np.nan)

    @property
    def solve_counts(self) -> SolveCounts:
        """Number of linear systems that each solver solved; by default none."""
        # imported here, because a case is read without the solvers
        from ..face.cell_flow import SolveCounts

        return SolveCounts()

    def contact_fraction_at(self, steps: LoadProgramme) -> Array:
        """Return the fraction of the surface in contact at load steps of the result (steps,), NaN if unknown."""
        return np.full(len(steps), np.nan)

    def open_leakage(self, scene: Scene) -> Array:
        """Return the leakage of a uniform gap that is equal to the mean gap (steps,) [m²/s], NaN if unknown."""
        return np.full(len(self.steps), np.nan)
