"""Compute the leakage of each measured patch, and of all patches but one."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from ..base import Array, Floats, Pair, Shown
from ..base.fields import PATCH, STEP, Field
from ..face.cell_flow import FlowSettings, attempt, solve_surface_flow
from ..loads import least_counted
from ..topography.patches import split_patches

#: Smallest number of measured patches for which the leakage without one of the patches is computed.
FEWEST_PATCHES = 3


@dataclass(frozen=True, repr=False)
class PatchLeakage(Shown):
    """Leakage of each measured patch, and the leakage with each patch left out in turn.

    The leakage is NaN where the flow solver failed.

    Parameters
    ----------
    selections : array (patches, steps) or (2 × patches, steps), m²/s
        Leakage of subsets of the patches. The first rows are for single patches, each continued periodically. If there
        are at least three patches, the second half of the rows contains the leave-one-out results, for which all
        patches except one are placed side by side.
    """

    selections: Array = field(metadata={"unit": "m^2/s"})

    computed_fields: ClassVar[dict[str, Field]] = {
        "alone": Field(
            "leakage_of_patches",
            "m^2/s",
            "leakage per unit seal length, of each patch alone",
            PATCH,
        ),
        "without": Field(
            "leakage_without_patch",
            "m^2/s",
            "leakage per unit seal length, of all patches but one",
            PATCH,
        ),
        "scatter": Field(
            "patch_scatter",
            "1",
            "standard deviation of the leakage of single patches over its mean",
            STEP,
            "patches ± [%]",
        ),
    }

    @property
    def alone(self) -> Array:
        """Leakage of each patch, as if it were the whole surface (patches, steps) [m²/s]."""
        return self.selections if self.without is None else self.selections[: len(self.without)]

    @property
    def without(self) -> Array | None:
        """Leakage of all patches but one, for each omitted patch (patches, steps) [m²/s]; None for two patches."""
        # With two patches, `selections` has two rows, and half of the rows is fewer than `FEWEST_PATCHES`.
        patches = len(self.selections) // 2
        return self.selections[patches:] if patches >= FEWEST_PATCHES else None

    @property
    def relative(self) -> Array:
        """Ratio of the leakage of each patch to the mean leakage of all patches (patches,).

        The ratio of each patch is averaged over the loads at which the mean leakage is not negligible. If no patch
        leaks, all ratios are 0.
        """
        mean = self.alone.mean(axis=0)
        is_counted = mean > least_counted(mean)
        ratios = self.alone[:, is_counted] / mean[is_counted]
        return ratios.sum(axis=1) / max(1, is_counted.sum())

    @property
    def scatter(self) -> Array:
        """Standard deviation of the leakage of single patches, divided by their mean leakage (steps,).

        The scatter is NaN at load steps at which no patch leaks.
        """
        mean = self.alone.mean(axis=0)
        return np.divide(
            self.alone.std(axis=0, ddof=1), mean, out=np.full(mean.shape, np.nan), where=mean > 0
        )


def permeabilities_of_patches(
    widths: tuple[int, ...], spacing: Pair, settings: FlowSettings, gap: Floats
) -> Array:
    """Compute the permeability of each measured patch, and of all patches with one of them left out.

    The leakages in `PatchLeakage` are computed from the returned permeabilities.

    Parameters
    ----------
    widths : tuple of int
        Number of points of each patch along x2.
    spacing : (float, float), m
        Spacing of the points.
    settings : FlowSettings
        Settings of the flow solver.
    gap : array (n1, n2), m
        Gap of all patches, which lie side by side.

    Returns
    -------
    array (patches,) or (2 × patches,), m³
        Permeability of each single patch. With at least three patches, the second half of the array contains the
        permeabilities with each patch left out in turn. A permeability is NaN if the flow solver failed.
    """
    patches = split_patches(gap, widths)
    selections = [[patch] for patch in patches]
    if len(patches) >= FEWEST_PATCHES:
        for left_out in range(len(patches)):
            selections.append([*patches[:left_out], *patches[left_out + 1 :]])
    permeabilities = []
    for selection in selections:
        joined_gap = np.concatenate(selection, axis=1)
        flow = attempt(solve_surface_flow, joined_gap, spacing, settings)
        permeabilities.append(flow.permeability)
    return np.array(permeabilities)
