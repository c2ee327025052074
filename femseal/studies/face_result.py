"""Define the result of the deterministic and the two-scale study: fields of a whole surface at every load step."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ..base import Array, InputError, Singles
from ..base.fields import PIXEL, ROW, STEP, declared
from ..checks import QuickEstimate
from ..contact import LoadState, coating_edge_distance
from ..face.cell_flow import FlowSettings, SolveCounts, attempt, solve_surface_flow
from ..loads import LoadProgramme
from ..scene import Scene
from ..scene.fluid_coupling import CoupledContact
from .cell_states import FaceCells
from .patch_leakage import PatchLeakage
from .study_result import SurfaceResult


@dataclass(frozen=True, eq=False)
class FaceState:
    """Contact of the whole surface at one load step, and the flow through its gap.

    Parameters
    ----------
    gap, pressure : array (n1, n2), m and Pa
        Gap and contact pressure.
    plastic : array of bytes
        One bit per pixel, set where the contact pressure has reached the hardness, see `numpy.packbits`.
    potential : array (n1, n2)
        Pressure potential of the flow, from 1 at the inlet to 0 at the outlet; NaN at contact points and in pockets
        without a connection to inlet or outlet.
    row_pressure : array (n1,), Pa
        Mean contact pressure of each row of pixels.
    carried : float, Pa
        Part of the nominal pressure that the fluid carries.
    permeability : float, m³
        Permeability of the surface along x1, NaN if the flow solver failed.
    solve_counts : SolveCounts
        Number of linear systems that each solver solved.
    flow_failure : str
        Reason why the flow solver failed; "" if the flow was solved.
    edge_distance : float, m
        Mean distance of the points that yield from the edge of their contact patch, see `contact.mean_edge_distance`;
        NaN without a coating.
    """

    gap: Singles
    pressure: Singles
    plastic: NDArray[np.uint8]
    potential: Singles
    row_pressure: Array
    contact_fraction: float
    plastic_fraction: float
    plastic_depth: float
    mean_gap: float
    residual: float
    carried: float
    permeability: float
    solve_counts: SolveCounts
    flow_failure: str = ""
    edge_distance: float = np.nan

    @classmethod
    def of(cls, state: LoadState, flow: FlowSettings) -> FaceState:
        """Solve the flow through the gap of a load step, unless the flow was solved together with the contact."""
        contact = state.contact
        solution: Any  # a flow, or `Failed`
        if isinstance(contact, CoupledContact):
            solution = contact.flow
            carried = contact.carried
        else:
            solution = attempt(solve_surface_flow, contact.gap, contact.half_space.spacing, flow)
            carried = 0.0
        unknown = np.full(contact.gap.shape, np.nan)
        return cls(
            gap=contact.gap.astype(np.float32),
            pressure=contact.pressure.astype(np.float32),
            plastic=np.packbits(contact.plastic),
            potential=getattr(solution, "potential", unknown).astype(np.float32),
            row_pressure=contact.pressure.mean(axis=1),
            contact_fraction=contact.area_fraction,
            plastic_fraction=contact.plastic_fraction,
            plastic_depth=float(contact.plastic_deformation.max()),
            mean_gap=contact.mean_gap,
            residual=contact.residual,
            carried=carried,
            permeability=solution.permeability,
            solve_counts=getattr(solution, "solve_counts", SolveCounts()),
            flow_failure=getattr(solution, "reason", ""),
            edge_distance=coating_edge_distance(contact),
        )


def fields_of_rows(row_pressure: Array, spacing: float) -> dict[str, Any]:
    """Compute the width of the contact band and the largest mean pressure of a row at every load step.

    The contact band extends from the first to the last row with contact, including these two rows.

    Parameters
    ----------
    row_pressure : array (steps, n1), Pa
        Mean contact pressure of each row.
    spacing : float, m
        Distance between neighbouring rows.

    Returns
    -------
    dict
        Values of the fields `row_pressure`, `band_breadth` and `largest_row_pressure` of a result.
    """
    touches = row_pressure > 0
    n1 = touches.shape[1]
    # `argmax` returns the index of the first row with contact, which is the number of rows outside of the band
    rows_before_band = touches.argmax(axis=1)  # counted from the inlet
    rows_after_band = touches[:, ::-1].argmax(axis=1)  # counted from the outlet
    rows_of_band = n1 - rows_before_band - rows_after_band
    return {
        "row_pressure": row_pressure,
        "band_breadth": np.where(touches.any(axis=1), rows_of_band, 0) * spacing,
        "largest_row_pressure": row_pressure.max(axis=1),
    }


@dataclass(frozen=True, repr=False)
class FaceResult(SurfaceResult):
    """Contact and flow of a whole surface at every load step, on all pixels and for all cells.

    Parameters
    ----------
    gap, contact_pressure, fluid_pressure : array (steps, n1, n2), m and Pa
        Fields on the pixels, in single precision. The fluid pressure is NaN at contact points and in pockets without a
        connection to inlet or outlet.
    leakage : array (steps,), m²/s
        Leakage per unit seal length, NaN where the flow solver failed.
    row_pressure : array (steps, n1), Pa
        Mean contact pressure of each row of pixels.
    cells : FaceCells, optional
        Cells of the surface; None in a result of the deterministic study, which does not use cells.
    patches : PatchLeakage, optional
        Leakage of each measured patch; None if there is only one patch.
    states : tuple of FaceState
        Contact state of the surface at every step.
    residual : float
        Largest residual at which the contact solver stopped.
    failures : tuple of str
        Reasons why values of the result are NaN.
    warnings : tuple of str
        One sentence for each result that is not plausible.
    quick_estimate : QuickEstimate, optional
        Leakage estimated from the spectrum of the surface; None if the estimate is not valid for this surface.
    face_solve_counts : SolveCounts
        Number of linear systems that each solver solved for the flow through the whole surface.
    """

    steps: LoadProgramme
    leakage: Array
    contact_fraction: Array = declared(
        "contact_fraction", "1", "fraction of the face in contact", STEP, heading="contact [%]"
    )
    plastic_fraction: Array = declared(
        "plastic_fraction", "1", "fraction of the face at the hardness", STEP
    )
    plastic_depth: Array = declared(
        "largest_plastic_depth", "m", "largest plastic deformation of the face", STEP
    )
    mean_gap: Array = declared("mean_gap", "m", "mean gap of the face", STEP)
    row_pressure: Array = declared(
        "row_pressure", "Pa", "mean contact pressure of rows", ROW, repr=False
    )
    band_breadth: Array = declared("band_breadth", "m", "breadth of the band in contact", STEP)
    largest_row_pressure: Array = declared(
        "largest_row_pressure", "Pa", "largest mean contact pressure of a row", STEP
    )
    gap: Singles = declared("gap", "m", "deformed gap", PIXEL)
    contact_pressure: Singles = declared("contact_pressure", "Pa", "contact pressure", PIXEL)
    fluid_pressure: Singles = declared(
        "fluid_pressure", "Pa", "fluid pressure, NaN in contact and in pockets", PIXEL
    )
    carried_pressure: Array | None = declared(
        "fluid_carried_pressure",
        "Pa",
        "mean pressure that the fluid carries of the load",
        STEP,
        default=None,
    )
    entry_pressure: Array | None = declared(
        "capillary_entry_pressure",
        "Pa",
        "pressure below which the liquid does not enter the critical constriction, inf where it is closed",
        STEP,
        default=None,
    )
    cells: FaceCells | None = field(default=None, repr=False)
    patches: PatchLeakage | None = field(default=None, repr=False)
    states: tuple[FaceState, ...] = field(default=(), repr=False)
    residual: float = 0.0
    failures: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    face_solve_counts: SolveCounts = field(default_factory=SolveCounts)
    quick_estimate: QuickEstimate | None = field(default=None, repr=False)

    patch_state: ClassVar[None] = None

    @property
    def solve_counts(self) -> SolveCounts:
        """Number of linear systems that each solver solved, for the surface and its cells."""
        if self.cells is None:
            return self.face_solve_counts
        return self.face_solve_counts + self.cells.solve_counts

    @property
    def method(self) -> str:
        """Name of the study, "two-scale" for a result with cells and "deterministic" for a result without cells."""
        return "deterministic" if self.cells is None else "two-scale"

    @property
    def surface_gap(self) -> Array:
        """Mean gap of the surface (steps,) [m]."""
        return self.mean_gap

    def contact_fraction_at(self, steps: LoadProgramme) -> Array:
        """Return the fraction of the surface in contact (steps,), at all load steps of the result."""
        return np.asarray(self.contact_fraction, float)

    def open_leakage(self, scene: Scene) -> Array:
        """Return the leakage of a uniform gap that is equal to the mean gap (steps,) [m²/s]."""
        return scene.unit_leakage * np.asarray(self.mean_gap, float) ** 3 / 12

    @property
    def without_cells(self) -> FaceResult:
        """Copy of the result without the cells, equal to the result of the deterministic study."""
        if self.cells is None:
            return self
        failures = tuple(text for text in self.failures if text not in self.cells.failures)
        return replace(self, cells=None, failures=failures)

    @property
    def k1(self) -> Array:
        """Permeability of the cells along x1 (steps, m1, m2) [m³]; raises InputError if there are no cells."""
        return self._existing_cells.k1

    @property
    def k2(self) -> Array:
        """Permeability of the cells along x2 (steps, m1, m2) [m³]; raises InputError if there are no cells."""
        return self._existing_cells.k2

    @property
    def _existing_cells(self) -> FaceCells:
        """Cells of the surface; raises InputError for a result of the deterministic study."""
        if self.cells is None:
            raise InputError(
                "cells", "a face that was not cut into cells", "the result of `two_scale`"
            )
        return self.cells
