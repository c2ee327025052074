"""Draw heights: maps, profiles and spectral densities, and the survey of a measured face.

The colour scale of a map of heights covers nearly all points. The few points far above or below it have two special
colours.
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
    label_decades,
    new_figure,
    set_panel_title,
    shows,
)
from .map_panels import draw_map, map_row_height, on_its_side

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Height of a panel with profiles [inch].
_PROFILE_HEIGHT = 2.2
#: Largest number of points of a map along each side. Maps of more points show means over blocks of points.
_MOST_POINTS = 1024
#: The colour scale covers at least the heights between these percentiles.
_PERCENTILES = (0.5, 99.5)
#: The colour scale can extend beyond each percentile by this fraction of the distance between the two.
_RANGE_MARGIN = 0.25
#: Colours of the points above and below the range of a map, with their names.
ABOVE, BELOW = ("#E31A1C", "red"), ("#00D5FF", "light blue")
_AXIS_NAMES = ("along x1 (leakage)", "along x2")
_WAVELENGTH = "wavelength 2π/q [µm]"


def height_range(heights: NDArray) -> Pair:
    """Find the range of the heights, leaving out a few outliers.

    Parameters
    ----------
    heights : array (any shape)
        Heights in any unit, NaN where undefined.

    Returns
    -------
    low, high : float
        Lowest and highest of the heights that are not outliers. Outliers lie far outside the range between the 0.5 and
        the 99.5 % percentile.
    """
    z = heights[~np.isnan(heights)]
    if not z.size:
        return 0.0, 1.0
    low, high = np.percentile(z, _PERCENTILES)
    margin = _RANGE_MARGIN * (high - low)
    z_without_outliers = z[(z >= low - margin) & (z <= high + margin)]
    low = z_without_outliers.min()
    high = z_without_outliers.max()
    if high == low:
        # nearly all points have the same height: the colours can as well show the outliers
        return z.min(), z.max()
    return low, high


def draw_heights(
    axes: Axes, heights: NDArray, size: Pair, title: str = "height [µm]", *, upright: bool = False
) -> None:
    """Draw a map of heights, whose colour bar says which fraction of the points lies outside the colour scale.

    Parameters
    ----------
    axes : Axes
        Axes to draw into.
    heights : array (n1, n2)
        Heights along x1 and x2 [µm]. Undefined points (NaN) are white.
    size : pair of float
        Sides of the face along x1 and x2 [mm].
    title : str
        Title of the panel.
    upright : bool
        True keeps x1 horizontal even if the map is high and narrow.
    """
    from matplotlib import colormaps

    low, high = height_range(heights)
    n_defined = max(int(np.count_nonzero(~np.isnan(heights))), 1)
    fraction_above = int(np.count_nonzero(heights > high)) / n_defined
    fraction_below = int(np.count_nonzero(heights < low)) / n_defined
    colours = colormaps["viridis"].with_extremes(over=ABOVE[0], under=BELOW[0], bad="white")
    extensions = {
        (False, False): "neither",
        (False, True): "min",
        (True, False): "max",
        (True, True): "both",
    }
    colours.colorbar_extend = extensions[fraction_above > 0, fraction_below > 0]  # type: ignore[assignment]
    bar = draw_map(axes, heights, size, colours, title, upright=upright, vmin=low, vmax=high)
    notes = []
    if fraction_above:
        notes.append(f"{ABOVE[1]}: {100 * fraction_above:.2g} % above")
    if fraction_below:
        notes.append(f"{BELOW[1]}: {100 * fraction_below:.2g} % below")
    if notes:
        bar.set_label(", ".join(notes), fontsize=8)


@shows(Topography)
@shows(Patches)
def heights_figure(topography: Surface) -> Figure:
    """Draw a map of heights, two profiles through the middle, and the spectral densities of profiles along both axes.

    Parameters
    ----------
    topography : Topography or Patches
        Surface whose heights are drawn. Spectral densities are left out if points are undefined. If there are several
        measured patches, the spectral densities are those of the longest patch.

    Returns
    -------
    Figure
    """
    width, length = topography.size
    map_height = map_row_height(on_its_side((width, length)), HEIGHTS)
    sheet = Sheet([map_height, _PROFILE_HEIGHT, _PROFILE_HEIGHT])
    heights = topography.heights
    if max(heights.shape) > _MOST_POINTS:
        heights = block_means(heights, _MOST_POINTS).astype(float)
    draw_heights(sheet.panel(0, HEIGHTS), heights * 1e6, (width * 1e3, length * 1e3))
    margins = replace(LINES, top=0.3)
    profile_axes = sheet.panel(1, margins)
    _draw_profiles(profile_axes, topography)
    density_axes = sheet.panel(2, margins)
    if topography.undefined_fraction:
        set_panel_title(density_axes, "no spectral density with undefined points")
    else:
        longest_patch = max(topography.patches, key=lambda patch: patch.shape[1])
        _draw_profile_densities(density_axes, longest_patch)
        label_decades(density_axes.xaxis)
        label_decades(density_axes.yaxis)
    for axes in (profile_axes, density_axes):
        _add_grid(axes)
    return sheet.figure


def _add_grid(axes: Axes) -> None:
    """Draw grid lines and small tick labels."""
    axes.grid(alpha=0.25, lw=0.6)
    axes.tick_params(which="both", labelsize=8)


def _draw_profiles(axes: Axes, topography: Surface) -> None:
    """Draw the profiles of the heights along both axes through the middle of the face."""
    z = topography.heights * 1e6
    n1, n2 = topography.shape
    profiles = (z[:, n2 // 2], z[n1 // 2])
    for axis, (profile, spacing) in enumerate(zip(profiles, topography.spacing, strict=True)):
        distance = (np.arange(profile.size) + 0.5) * spacing * 1e3
        axes.plot(distance, profile, lw=1.1, label=_AXIS_NAMES[axis], **STYLES[axis])
    axes.set(xlabel="distance [mm]", ylabel="height [µm]")
    axes.legend(fontsize=7.5, framealpha=0.9)
    set_panel_title(axes, "profiles through the middle")


def _draw_profile_densities(axes: Axes, topography: Topography) -> None:
    """Draw the spectral density of profiles along each axis, averaged over all profiles."""
    for axis in (0, 1):
        q, density = topography.psd(axis)
        is_drawn = (q > 0) & (density > density.max() * 1e-12)
        wavelength = _wavelength_um(q[is_drawn])
        style = {"lw": 1.2, "label": _AXIS_NAMES[axis], **STYLES[axis]}
        axes.loglog(wavelength, density[is_drawn], **style)
    axes.set(xlabel=_WAVELENGTH, ylabel="spectral density [m³]")
    axes.xaxis.set_inverted(True)
    set_panel_title(axes, "mean spectral density of profiles")
    axes.legend(fontsize=8, framealpha=0.9)


def _wavelength_um(q: Array) -> Array:
    """Convert wavenumbers [rad/m] to wavelengths [µm]."""
    return 2e6 * pi / q


def survey_figure(
    topography: Topography,
    report: SurfaceReport | None = None,
    conditioning: Conditioning | None = None,
    *,
    detrend: int | None = None,
    spikes: float = SPIKES,
) -> Figure:
    """Draw the survey of a measured face: map, histogram of heights, and two spectral densities.

    Parameters
    ----------
    topography : Topography
        Measured heights.
    report : SurfaceReport, optional
        Description of this surface by `describe_surface`. Without it, the spectral densities are left out.
    conditioning : Conditioning, optional
        Record of how `condition` changes this surface in a run. If it is given, its shortest wave is marked.
    detrend : int, optional
        Order of the polynomial form that is removed, as in `condition`.
    spikes : float
        Threshold for the detection of spikes, as in `condition`.

    Returns
    -------
    Figure
    """
    figure = new_figure(11.0, 8.0)
    (map_axes, histogram_axes), (radial_axes, profile_axes) = figure.subplots(2, 2)
    without_spikes = topography.without_spikes(spikes)
    is_spike = np.isnan(without_spikes.heights) & ~np.isnan(topography.heights)
    measured = topography
    if topography.undefined_fraction < 1:
        measured = topography.detrend(detrend)
    _draw_measured_map(map_axes, measured, is_spike)
    _draw_histogram(histogram_axes, measured)
    if report is not None:
        complete = without_spikes.fill_undefined(1.0).detrend(detrend)
        _draw_radial_density(radial_axes, complete, report, conditioning)
        _draw_profile_densities(profile_axes, complete)
    for axes in (histogram_axes, radial_axes, profile_axes):
        _add_grid(axes)
    return figure


def _draw_measured_map(axes: Axes, measured: Topography, is_spike: Flags) -> None:
    """Draw a map of the measured heights, with a dot at every point at which `is_spike` (n1, n2) is true."""
    titles = ["levelled height [µm]"]
    if measured.undefined_fraction:
        titles.append(f"white: {100 * measured.undefined_fraction:.2g} % undefined")
    n_spikes = np.count_nonzero(is_spike)
    if n_spikes:
        titles.append(f"dots: {counted(n_spikes, 'point')} in spikes")
    width, length = measured.size[0] * 1e3, measured.size[1] * 1e3
    title = "; ".join(titles)
    draw_heights(axes, measured.heights * 1e6, (width, length), title, upright=True)
    i, j = np.nonzero(is_spike)
    x1 = (i + 0.5) * measured.spacing[0] * 1e3
    x2 = (j + 0.5) * measured.spacing[1] * 1e3
    axes.plot(x1, x2, "o", color="#D55E00", ms=3, mew=0)
    axes.set(xlim=(0, width), ylim=(0, length))


def _draw_histogram(axes: Axes, measured: Topography) -> None:
    """Draw the probability density of the heights about their mean, on a logarithmic scale."""
    axes.set(xlabel="height [µm]", ylabel="probability density [1/µm]")
    axes.set_title("heights", fontsize=9.5)
    z = measured.heights[~np.isnan(measured.heights)] * 1e6
    if not z.size:
        return
    density, edges = np.histogram(z - z.mean(), bins=200, density=True)
    axes.stairs(density, edges, fill=True, color=STYLES[1]["color"], alpha=0.75)
    axes.set_yscale("log")
    axes.set_ylim(density[density > 0].min() / 2, density.max() * 3)


def _draw_radial_density(
    axes: Axes, complete: Topography, report: SurfaceReport, conditioning: Conditioning | None
) -> None:
    """Draw the spectral density averaged over directions.

    The fitted power law and the shortest waves, of the measurement and of the run, are marked.
    """
    q, density = complete.radial_psd()
    is_drawn = (q > 0) & (density > density.max(initial=0.0) * 1e-14)
    axes.loglog(_wavelength_um(q[is_drawn]), density[is_drawn], color=GREY, lw=1.0)
    if report.power_law is not None:
        q_ends = 2 * pi / np.array(report.power_law)
        # a self-affine surface with the Hurst exponent H has the density C(q) ~ q^(-2 - 2 H)
        fit = report.power_law_density * (q_ends / q_ends[0]) ** (-2 - 2 * report.hurst)
        exponent, error = report.power_law_slope
        label = f"q^({exponent:.2f} ± {error:.2f}), H = {report.hurst:.2f}"
        axes.loglog(_wavelength_um(q_ends), fit, color=STYLES[0]["color"], lw=2.2, label=label)
    if conditioning is not None:
        _mark_wavelength(axes, conditioning.shortest_wave, "low-pass of a run", 2)
    _mark_wavelength(axes, report.shortest_wave, "shortest wave measured", 3)
    axes.set(xlabel=_WAVELENGTH, ylabel="spectral density [m⁴]")
    axes.xaxis.set_inverted(True)
    axes.set_title("spectral density averaged over directions", fontsize=9.5)
    axes.legend(fontsize=8, framealpha=0.9, edgecolor="none")


def _mark_wavelength(axes: Axes, wavelength: float, name: str, style: int) -> None:
    """Draw a vertical line at a wavelength [m], with its name and value in the legend."""
    label = f"{name}, {to_text(wavelength, 'm', 3)}"
    axes.axvline(1e6 * wavelength, lw=1.3, label=label, **STYLES[style])
