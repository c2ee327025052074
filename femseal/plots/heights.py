"""Picture of heights: map, profiles, spectral densities."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..results.face_maps import block_means
from ..topography import Topography
from .drawing import HEIGHTS, LINES, STYLES, Sheet, map_row
from .height_map import height_panel
from .registry import shows
from .scales_of_axes import decades

if TYPE_CHECKING:
    from matplotlib.figure import Figure


Array = NDArray[np.float64]
#: Least height of the panels of profiles [inch], and most points of a map along a side.
_PROFILE, _SEEN = 2.2, 1024


@shows(Topography)
def heights_figure(topography: Topography) -> Figure:
    """Heights, their profiles through the middle, and the spectral density of profiles along both axes.

    Parameters
    ----------
    topography : heights; where points are undefined the spectral densities are left out.
    """
    l1, l2 = topography.size
    row = max(map_row((l1, l2), HEIGHTS), 2 * _PROFILE)
    sheet = Sheet([row], columns=2)
    height_panel(sheet.panel(0, 0, HEIGHTS), _drawn_heights(topography.heights) * 1e6, (l1 * 1e3, l2 * 1e3))
    upper, lower = replace(LINES, bottom=row / 2 + 0.55), replace(LINES, top=row / 2 + 0.35)
    profile, density = sheet.panel(0, 1, upper), sheet.panel(0, 1, lower)
    z, (n1, n2), (d1, d2) = topography.heights * 1e6, topography.shape, topography.spacing
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
    for axes in (profile, density):
        axes.grid(alpha=0.25, lw=0.6)
        axes.tick_params(labelsize=8)
    if topography.undefined_share:
        density.annotate("undefined points", (0.5, 0.5), xycoords="axes fraction", ha="center", va="center")
    else:
        decades(density.xaxis)
        decades(density.yaxis)
        density.legend(fontsize=8, framealpha=0.9)
    return sheet.figure


def _drawn_heights(heights: Array) -> Array:
    """Heights as many as can be seen."""
    return heights if max(heights.shape) <= _SEEN else block_means(heights, _SEEN).astype(float)
