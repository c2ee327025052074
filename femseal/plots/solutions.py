"""Pictures of single solutions: a contact, a load cycle, the flow in a cell, the leakage of a seal."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..base.errors import InputError
from ..contact import Contact, LoadCycle, LoadState
from ..flow import Permeability
from ..results.selections import branches, pressures_and_peaks
from ..seal import Leakage
from .drawing import POCKET, branch_styles, map_height, map_panel, new_figure, one_panel, shows, with_closed

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


@shows(Contact)
def contact_figure(contact: Contact) -> Figure:
    """Maps of contact pressure and gap; grey: no contact, contact."""
    l1, l2 = (n * d * 1e3 for n, d in zip(contact.gap.shape, contact.half_space.spacing, strict=True))
    figure = new_figure(11.0, map_height((l1, l2), 4.4) + 0.9)
    left, right = figure.subplots(1, 2)
    pressure, gap = (np.where(a > 0, a, np.nan) for a in (contact.pressure / 1e6, contact.gap * 1e6))
    map_panel(left, pressure, (l1, l2), with_closed("viridis"), "contact pressure [MPa]; grey: no contact")
    map_panel(right, gap, (l1, l2), with_closed("magma"), "gap [µm]; grey: contact")
    return figure


@shows(LoadState)
def state_figure(state: LoadState) -> Figure:
    """Maps of contact pressure and gap at a step of a cycle."""
    figure = contact_figure(state.contact)
    figure.suptitle(state.name, fontsize=11)
    return figure


@shows(LoadCycle)
def cycle_figure(cycle: LoadCycle) -> Figure:
    """Fraction in contact and mean gap against nominal pressure."""
    figure = new_figure(9.6, 4.0)
    left, right = figure.subplots(1, 2)
    _cycle_panel(left, cycle, np.array([100 * s.contact.area_fraction for s in cycle]), "fraction in contact [%]")
    _cycle_panel(right, cycle, np.array([s.contact.mean_gap * 1e6 for s in cycle]), "mean gap [µm]")
    left.legend(fontsize=8.5, frameon=False)
    return figure


def _cycle_panel(axes: Axes, steps: Sequence[Any], values: NDArray[np.float64], label: str) -> None:
    """Values at the steps of a cycle against nominal pressure, a curve for each branch."""
    pressure, peaks = pressures_and_peaks(steps)
    parts = branches(pressure, peaks)
    for (name, chosen), (colour, line, marker) in zip(parts, branch_styles(len(parts)), strict=True):
        axes.plot(pressure[chosen] / 1e6, values[chosen], color=colour, ls=line, marker=marker, ms=4.5, label=name)
    axes.set(xlabel="nominal pressure [MPa]", ylabel=label)
    axes.grid(alpha=0.25, lw=0.6)


@shows(Permeability)
def permeability_figure(permeability: Permeability, ax: Axes | None = None) -> Figure:
    """Map of the fluid pressure in a cell for a unit drop."""
    n1, n2 = permeability.fluid_pressure.shape
    figure, axes = one_panel(ax, 6.0, map_height((n1, n2), 4.6) + 0.9)
    title = "fluid pressure for a unit drop; white: contact, pockets"
    map_panel(axes, permeability.fluid_pressure, (n1, n2), with_closed("cividis", POCKET), title, "pixels")
    return figure


@shows(Leakage)
def seal_leakage_figure(leakage: Leakage, ax: Axes | None = None) -> Figure:
    """Map of the fluid pressure at the nodes of a structured seal.

    Raises
    ------
    InputError : the leakage of a mesh, whose nodes have no rows.
    """
    if leakage.fluid_pressure.ndim != 2:
        given = f"the leakage of a mesh, with {leakage.fluid_pressure.size} nodes"
        raise InputError("plot", given, "that of a seal with rows of nodes, rectangular or annular")
    n1, n2 = leakage.fluid_pressure.shape
    figure, axes = one_panel(ax, 6.4, map_height((n1, n2), 4.8) + 0.9)
    title = "fluid pressure [MPa]; white: pockets"
    map_panel(axes, leakage.fluid_pressure / 1e6, (n1, n2), with_closed("cividis", POCKET), title, "nodes")
    return figure
