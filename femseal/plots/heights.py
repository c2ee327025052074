"""Picture of heights: map, profiles, spectral densities."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..topography import Topography
from .drawing import STYLES, new_figure
from .height_map import height_panel
from .registry import shows

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@shows(Topography)
def heights_figure(topography: Topography) -> Figure:
    """Heights, their profiles through the middle, and the spectral density of profiles along both axes.

    Parameters
    ----------
    topography : heights; where points are undefined the spectral densities are left out.
    """
    from matplotlib.ticker import NullFormatter

    z = topography.heights * 1e6
    (n1, n2), (l1, l2), (d1, d2) = topography.shape, topography.size, topography.spacing
    figure = new_figure(11.0, float(np.clip(5.6 * l1 / l2, 3.4, 5.6)) + 0.8)
    grid = figure.add_gridspec(2, 2, width_ratios=(1.25, 1))
    image, profile, density = (figure.add_subplot(place) for place in (grid[:, 0], grid[0, 1], grid[1, 1]))
    height_panel(image, z, (l1 * 1e3, l2 * 1e3))
    for axis, (line, n, d) in enumerate(((z[:, n2 // 2], n1, d1), (z[n1 // 2], n2, d2))):
        colour, style, _ = STYLES[axis]
        label = ("along x1 (leakage)", "along x2")[axis]
        profile.plot((np.arange(n) + 0.5) * d * 1e3, line, color=colour, ls=style, lw=1.1, label=label)
        if topography.undefined_share == 0:
            q, c = topography.psd(axis)
            shown = (q > 0) & (c > c.max() * 1e-12)
            density.loglog(q[shown], c[shown], color=colour, ls=style, lw=1.3, label=label)
    profile.set(xlabel="distance [mm]", ylabel="height [µm]")
    profile.set_title("profiles through the middle", fontsize=9.5)
    density.set(xlabel="wavenumber q = 2π/λ [rad/m]", ylabel="spectral density [m³]")
    density.set_title("mean spectral density of profiles", fontsize=9.5)
    density.xaxis.set_minor_formatter(NullFormatter())
    for axes in (profile, density):
        axes.grid(alpha=0.25, lw=0.6)
        axes.tick_params(labelsize=8)
    if topography.undefined_share:
        density.annotate("undefined points", (0.5, 0.5), xycoords="axes fraction", ha="center", va="center")
    figure.align_ylabels((profile, density))
    figure.legend(*profile.get_legend_handles_labels(), loc="outside upper right", ncols=2, fontsize=8.5, frameon=False)
    return figure
