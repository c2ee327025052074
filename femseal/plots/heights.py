"""Pictures of heights: map, profiles, spectral densities; and of a measured face with what was found in it.

The colours of a map of heights are for the many points: the few far above or below have colours of their own.
"""

from __future__ import annotations

from dataclasses import replace
from math import pi
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..base import Array, Flags, Pair, counted, to_text
from ..results.variables import block_means
from ..topography import SPIKES, Conditioning, Patches, Surface, SurfaceReport, Topography
from .drawing import (
    GREY,
    HEIGHTS,
    LINES,
    STYLES,
    Sheet,
    decades,
    lying,
    map_panel,
    map_row,
    new_figure,
    panel_title,
    shows,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Height of the panels of profiles [inch], and most points of a map along a side.
_PROFILE, _SEEN = 2.2, 1024
#: Percentiles between which the colours lie at least, and the fraction of their distance that is added at both ends.
_PERCENTILES = (0.5, 99.5)
_MARGIN = 0.25
#: Colours of points above and below the range, with their names.
ABOVE, BELOW = ("#E31A1C", "red"), ("#00D5FF", "light blue")
#: Names of the axes.
_ALONG = ("along x1 (leakage)", "along x2")


def height_range(heights: NDArray) -> Pair:
    """Range that a few outliers do not widen: of all heights that are no farther than a margin from percentiles."""
    z = heights[~np.isnan(heights)]
    if not z.size:
        return 0.0, 1.0
    low, high = np.percentile(z, _PERCENTILES)
    margin = _MARGIN * (high - low)
    near = z[(z >= low - margin) & (z <= high + margin)]
    low, high = near.min(), near.max()
    if high == low:  # nearly all points at one height: nothing to spread but the outliers
        low, high = z.min(), z.max()
    return low, high


def height_panel(
    axes: Axes, heights: NDArray, size: Pair, title: str = "height [µm]", *, upright: bool = False
) -> None:
    """Map of heights (n1, n2) [µm] over a face of a size [mm]; the colour bar says what is out of its range.

    Undefined points are white. upright : see `map_panel`.
    """
    from matplotlib import colormaps

    low, high = height_range(heights)
    known = max(int(np.count_nonzero(~np.isnan(heights))), 1)
    above, below = (int(np.count_nonzero(out)) / known for out in (heights > high, heights < low))
    colours = colormaps["viridis"].with_extremes(over=ABOVE[0], under=BELOW[0], bad="white")
    ends = ("neither", "min"), ("max", "both")
    colours.colorbar_extend = ends[above > 0][below > 0]  # type: ignore[assignment]
    bar = map_panel(axes, heights, size, colours, title, upright=upright, vmin=low, vmax=high)
    parts = ((above, ABOVE, "above"), (below, BELOW, "below"))
    if texts := [f"{name}: {100 * part:.2g} % {where}" for part, (_, name), where in parts if part]:
        bar.set_label(", ".join(texts), fontsize=8)


@shows(Topography)
@shows(Patches)
def heights_figure(topography: Surface) -> Figure:
    """Heights, their profiles through the middle, and the spectral density of profiles along both axes.

    topography : heights; where points are undefined the spectral densities are left out. Of several patches side by
        side the spectral densities are those of the longest one.
    """
    l1, l2 = topography.size
    sheet = Sheet([map_row(lying((l1, l2)), HEIGHTS), _PROFILE, _PROFILE])
    heights = topography.heights
    seen = heights if max(heights.shape) <= _SEEN else block_means(heights, _SEEN).astype(float)
    height_panel(sheet.panel(0, HEIGHTS), seen * 1e6, (l1 * 1e3, l2 * 1e3))
    profile, density = (sheet.panel(row, replace(LINES, top=0.3)) for row in (1, 2))
    z, (n1, n2), (d1, d2) = topography.heights * 1e6, topography.shape, topography.spacing
    for axis, (line, n, d) in enumerate(((z[:, n2 // 2], n1, d1), (z[n1 // 2], n2, d2))):
        x = (np.arange(n) + 0.5) * d * 1e3
        profile.plot(x, line, lw=1.1, label=_ALONG[axis], **STYLES[axis])
    profile.set(xlabel="distance [mm]", ylabel="height [µm]")
    profile.legend(fontsize=7.5, framealpha=0.9)
    panel_title(profile, "profiles through the middle")
    if topography.undefined_fraction:
        panel_title(density, "no spectral density with undefined points")
    else:
        _densities_panel(density, max(topography.patches, key=lambda patch: patch.shape[1]))
        decades(density.xaxis)
        decades(density.yaxis)
    for axes in (profile, density):
        axes.grid(alpha=0.25, lw=0.6)
        axes.tick_params(which="both", labelsize=8)
    return sheet.figure


_WAVELENGTH = "wavelength 2π/q [µm]"


def _densities_panel(axes: Axes, topography: Topography) -> None:
    """Spectral densities of profiles along both axes."""
    for axis in (0, 1):
        q, density = topography.psd(axis)
        shown = (q > 0) & (density > density.max() * 1e-12)
        axes.loglog(_um(q[shown]), density[shown], lw=1.2, label=_ALONG[axis], **STYLES[axis])
    axes.set(xlabel=_WAVELENGTH, ylabel="spectral density [m³]")
    axes.xaxis.set_inverted(True)
    panel_title(axes, "mean spectral density of profiles")
    axes.legend(fontsize=8, framealpha=0.9)


def _um(q: Array) -> Array:
    """Wavelengths [µm] of wavenumbers [rad/m]."""
    return 2e6 * pi / q


def survey_figure(
    topography: Topography,
    report: SurfaceReport | None = None,
    conditioning: Conditioning | None = None,
    *,
    detrend: int | None = None,
    spikes: float = SPIKES,
) -> Figure:
    """Levelled map with undefined points and spikes, histogram of heights, radial and profile spectral densities.

    topography : as measured.
    report, conditioning : of the same map, from `describe_surface` and `condition`; None is unknown.
    detrend, spikes : as given to these.
    """
    figure = new_figure(11.0, 8.0)
    (image, histogram), (radial, profiles) = figure.subplots(2, 2)
    marked = topography.without_spikes(spikes)
    measured = topography if topography.undefined_fraction == 1 else topography.detrend(detrend)
    _map_panel(image, measured, np.isnan(marked.heights) & ~np.isnan(topography.heights))
    _histogram_panel(histogram, measured)
    if report is not None:
        flat = marked.fill_undefined(1.0).detrend(detrend)
        _radial_panel(radial, flat, report, conditioning)
        _densities_panel(profiles, flat)
    for axes in (histogram, radial, profiles):
        axes.grid(alpha=0.25, lw=0.6)
        axes.tick_params(which="both", labelsize=8)
    return figure


def _map_panel(axes: Axes, measured: Topography, spikes: Flags) -> None:
    """Map of the heights, with marks at spikes."""
    notes = []
    if measured.undefined_fraction:
        notes.append(f"white: {100 * measured.undefined_fraction:.2g} % undefined")
    if count := np.count_nonzero(spikes):
        notes.append(f"dots: {counted(count, 'point')} in spikes")
    l1, l2 = (length * 1e3 for length in measured.size)
    height_panel(
        axes,
        measured.heights * 1e6,
        (l1, l2),
        "; ".join(["levelled height [µm]", *notes]),
        upright=True,
    )
    x1, x2 = (
        (k + 0.5) * d * 1e3 for k, d in zip(np.nonzero(spikes), measured.spacing, strict=True)
    )
    axes.plot(x1, x2, "o", color="#D55E00", ms=3, mew=0)
    axes.set(xlim=(0, l1), ylim=(0, l2))


def _histogram_panel(axes: Axes, measured: Topography) -> None:
    """Probability density of the heights, log scale."""
    axes.set(xlabel="height [µm]", ylabel="probability density [1/µm]")
    axes.set_title("heights", fontsize=9.5)
    z = measured.heights[~np.isnan(measured.heights)] * 1e6
    if not z.size:
        return
    z = z - z.mean()
    density, edges = np.histogram(z, bins=200, density=True)
    axes.stairs(density, edges, fill=True, color=STYLES[1]["color"], alpha=0.75)
    axes.set_yscale("log")
    axes.set_ylim(density[density > 0].min() / 2, density.max() * 3)


def _radial_panel(
    axes: Axes, flat: Topography, report: SurfaceReport, conditioning: Conditioning | None
) -> None:
    """Spectral density averaged over directions, with its power law, and the shortest waves."""
    q, density = flat.radial_psd()
    shown = (q > 0) & (density > density.max(initial=0.0) * 1e-14)
    axes.loglog(_um(q[shown]), density[shown], color=GREY, lw=1.0)
    if report.power_law is not None:
        ends = 2 * pi / np.array(report.power_law)
        law = report.power_law_density * (ends / ends[0]) ** (-2 - 2 * report.hurst)
        slope, error = report.power_law_slope
        label = f"q^({slope:.2f} ± {error:.2f}), H = {report.hurst:.2f}"
        axes.loglog(_um(ends), law, color=STYLES[0]["color"], lw=2.2, label=label)
    marks = [(report.shortest_wave, STYLES[3], "shortest wave measured")]
    if conditioning is not None:
        marks.insert(0, (conditioning.shortest_wave, STYLES[2], "low-pass of a run"))
    for wave, style, name in marks:
        axes.axvline(1e6 * wave, lw=1.3, label=f"{name}, {to_text(wave, 'm', 3)}", **style)
    axes.set(xlabel=_WAVELENGTH, ylabel="spectral density [m⁴]")
    axes.xaxis.set_inverted(True)
    axes.set_title("spectral density averaged over directions", fontsize=9.5)
    axes.legend(fontsize=8, framealpha=0.9, edgecolor="none")
