"""Draw heights: maps, profiles and spectral densities, and the survey of a measured face.

A map of heights is a shaded relief, lit from the upper left. The colour scale of the map covers the heights of nearly
all points. The few points that are much higher or much lower than the colour scale have special colours.
"""

from __future__ import annotations

from dataclasses import replace
from math import pi
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..base import Array, Flags, Pair, counted, to_text
from ..topography import SPIKES, Conditioning, Patches, Surface, SurfaceReport, Topography
from .drawing import (
    LINES,
    MAP,
    Sheet,
    add_grid,
    label_decades,
    length_unit,
    shows,
    write_in_the_middle,
)
from .map_panels import (
    add_key,
    add_shade,
    draw_map,
    is_turned,
    map_dpi,
    map_row_height,
    reduced,
    to_image,
)
from .style import GREY, STYLES, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Height of a panel with lines [inch].
_PANEL_HEIGHT = 1.9
#: Margins of a panel whose vertical axis has a name of two lines.
_TWO_LINES = replace(LINES, left=LINES.left + 0.1)
#: The colour scale covers at least the heights between these percentiles.
_PERCENTILES = (0.5, 99.5)
#: The colour scale can extend beyond each percentile by this fraction of the distance between the two percentiles.
_RANGE_MARGIN = 0.25
#: Colours of the points above and below the range of a map: red and light blue.
ABOVE_COLOUR, BELOW_COLOUR = "#E31A1C", "#00D5FF"
_AXIS_NAMES = ("along $x_1$ (leakage)", "along $x_2$")
#: Rms slope to which the heights are scaled for the relief, and direction towards the light: from the upper left, at
#: 45° to the surface (components to the right, upwards and out of the picture).
_RELIEF_SLOPE = 0.7
_LIGHT = (-0.5, 0.5, 0.5**0.5)
#: Largest opacity of the black of shadows and of the white of lights in the relief.
_MOST_SHADE = 0.55
_WAVELENGTH = "wavelength $2\\pi/q$ [µm]"


def height_range(heights: NDArray) -> Pair:
    """Find the lowest and the highest height of a surface, leaving out a few outliers.

    Parameters
    ----------
    heights : array (any shape)
        Heights in any unit, NaN where undefined.

    Returns
    -------
    low, high : float
        Lowest and highest height that is not an outlier. Outliers are heights far outside the range from the 0.5th to
        the 99.5th percentile of the heights.
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
        # nearly all points have the same height, so that the colours can show the outliers instead
        return z.min(), z.max()
    return low, high


def draw_heights(axes: Axes, heights: NDArray, size: Pair, name: str = "height [µm]") -> None:
    """Draw a map of heights as a shaded relief. A legend states the fraction of points outside the colour scale.

    Parameters
    ----------
    axes : Axes
        Axes to draw into.
    heights : array (n1, n2)
        Heights along x1 and x2 [µm]. Undefined points (NaN) are white.
    size : pair of float
        Sides of the face along x1 and x2 [m].
    name : str
        Name of the heights with their unit.
    """
    from matplotlib import colormaps

    low, high = height_range(heights)
    n_defined = max(int(np.count_nonzero(~np.isnan(heights))), 1)
    fraction_above = int(np.count_nonzero(heights > high)) / n_defined
    fraction_below = int(np.count_nonzero(heights < low)) / n_defined
    colours = colormaps["viridis"].with_extremes(over=ABOVE_COLOUR, under=BELOW_COLOUR, bad="white")
    extensions = {
        (False, False): "neither",
        (False, True): "min",
        (True, False): "max",
        (True, True): "both",
    }
    colours.colorbar_extend = extensions[fraction_above > 0, fraction_below > 0]  # type: ignore[assignment]
    draw_map(axes, heights, size, colours, name, vmin=low, vmax=high)
    if min(heights.shape) > 1:
        _draw_relief(axes, to_image(heights, size))
    key = {}
    if fraction_above:
        key[f"{100 * fraction_above:.2g} % above"] = ABOVE_COLOUR
    if fraction_below:
        key[f"{100 * fraction_below:.2g} % below"] = BELOW_COLOUR
    if key:
        add_key(axes, key)


def _draw_relief(axes: Axes, heights: NDArray) -> None:
    """Shade the map of heights in the axes, like a relief that is lit from the upper left.

    heights : heights in the orientation of the picture, (row, column), with the lowest row of the picture first.
    """
    left, right, bottom, top = axes.images[0].get_extent()
    spacing = (top - bottom) / heights.shape[0], (right - left) / heights.shape[1]
    slope_up, slope_right = np.gradient(heights, *spacing)
    rms_slope = (
        np.sqrt(np.nanmean(slope_up**2 + slope_right**2)) if np.isfinite(slope_up).any() else 0
    )
    if not rms_slope > 0:
        return
    slope_up *= _RELIEF_SLOPE / rms_slope
    slope_right *= _RELIEF_SLOPE / rms_slope
    to_right, upwards, outwards = _LIGHT
    # diffuse reflection: the scalar product of the direction towards the light and the unit normal of the surface
    light = outwards - to_right * slope_right - upwards * slope_up
    light /= np.sqrt(1 + slope_right**2 + slope_up**2)
    difference = np.nan_to_num(light - outwards)  # 0 on a level surface
    # white where the light is brighter than on a level surface, black elsewhere
    is_bright = (difference > 0)[..., None]
    add_shade(axes, is_bright, np.clip(np.abs(difference), 0, _MOST_SHADE))


@shows(Topography)
@shows(Patches)
def heights_figure(topography: Surface) -> Figure:
    """Draw a map of heights, two profiles through the middle, and the spectral densities of profiles along both axes.

    Parameters
    ----------
    topography : Topography or Patches
        Surface whose heights are drawn. For a surface with undefined points, the spectral densities are left out. For
        several measured patches, the spectral densities are computed from the longest patch.

    Returns
    -------
    Figure
    """
    heights = reduced(topography.heights)
    row_heights = [map_row_height(topography.size), _PANEL_HEIGHT, _PANEL_HEIGHT]
    sheet = Sheet(row_heights, dpi=map_dpi(heights.shape))
    draw_heights(sheet.panel(0, MAP), heights * 1e6, topography.size)
    _draw_profiles(sheet.panel(1, LINES), topography)
    density_axes = sheet.panel(2, _TWO_LINES)
    if topography.undefined_fraction:
        write_in_the_middle(density_axes, "no spectral density with undefined points")
        density_axes.set(xticks=[], yticks=[])
    else:
        longest_patch = max(topography.patches, key=lambda patch: patch.shape[1])
        _draw_profile_densities(density_axes, longest_patch)
    return sheet.figure


def _draw_profiles(axes: Axes, topography: Surface) -> None:
    """Draw the profiles of the heights along both axes through the middle of the face."""
    z = topography.heights * 1e6
    n1, n2 = topography.shape
    unit, unit_name = length_unit(max(topography.size))
    profiles = (z[:, n2 // 2], z[n1 // 2])
    for axis, (profile, spacing) in enumerate(zip(profiles, topography.spacing, strict=True)):
        distance = (np.arange(profile.size) + 0.5) * spacing / unit
        axes.plot(distance, profile, lw=0.8, label=_AXIS_NAMES[axis], **STYLES[axis])
    axes.set(xlabel=f"distance [{unit_name}]", ylabel="height [µm]")
    axes.margins(x=0.0, y=0.15)
    add_grid(axes)
    axes.legend(loc="upper center", ncols=2, bbox_to_anchor=(0.5, 1.03))


def _draw_profile_densities(axes: Axes, topography: Topography) -> None:
    """Draw the spectral density of profiles along each axis, averaged over all profiles."""
    for axis in (0, 1):
        q, density = topography.psd(axis)
        is_drawn = (q > 0) & (density > density.max() * 1e-12)
        wavelength = _wavelength_um(q[is_drawn])
        axes.loglog(wavelength, density[is_drawn], label=_AXIS_NAMES[axis], **STYLES[axis])
    axes.set(xlabel=_WAVELENGTH, ylabel="mean spectral density\nof profiles [m³]")
    axes.xaxis.set_inverted(True)
    label_decades(axes.xaxis)
    label_decades(axes.yaxis)
    add_grid(axes)
    axes.legend(loc="lower left")


def _wavelength_um(q: Array) -> Array:
    """Convert wavenumbers [rad/m] to wavelengths [µm]."""
    return 2e6 * pi / q


@styled
def survey_figure(
    topography: Topography,
    report: SurfaceReport | None = None,
    conditioning: Conditioning | None = None,
    *,
    detrend: int | None = None,
    spikes: float = SPIKES,
) -> Figure:
    """Draw a measured face: a map of the heights, their probability density, and two spectral densities.

    Parameters
    ----------
    topography : Topography
        Measured heights.
    report : SurfaceReport, optional
        Description of the face by `describe_surface`. Without `report`, the spectral densities are left out.
    conditioning : Conditioning, optional
        Report of `condition` on the face. With `conditioning`, the figure marks the cut-off wavelength of the low-pass
        filter that a run applies.
    detrend : int, optional
        Order of the polynomial that is subtracted from the heights, see `condition`.
    spikes : float
        Threshold for the detection of spikes, see `condition`.

    Returns
    -------
    Figure
    """
    without_spikes = topography.without_spikes(spikes)  # spikes are undefined points here
    is_spike = np.isnan(without_spikes.heights) & ~np.isnan(topography.heights)
    # The map and the histogram include the spikes. For the spectra, spikes and undefined points are filled.
    measured = topography
    if topography.undefined_fraction < 1:
        measured = topography.detrend(detrend)
    n_lines = 1 if report is None else 3
    row_heights = [map_row_height(measured.size), *[_PANEL_HEIGHT] * n_lines]
    sheet = Sheet(row_heights, head=0.3, dpi=map_dpi(measured.shape))
    _draw_measured_map(sheet.panel(0, MAP), measured, is_spike)
    _draw_histogram(sheet.panel(1, _TWO_LINES), measured)
    if report is not None:
        complete = without_spikes.fill_undefined(1.0).detrend(detrend)
        _draw_radial_density(sheet.panel(2, _TWO_LINES), complete, report, conditioning)
        _draw_profile_densities(sheet.panel(3, _TWO_LINES), complete)
    return sheet.figure


def _draw_measured_map(axes: Axes, measured: Topography, is_spike: Flags) -> None:
    """Draw a map of the measured heights, with a dot at every spike, where `is_spike` (n1, n2) is True."""
    draw_heights(axes, measured.heights * 1e6, measured.size, "levelled height [µm]")
    notes = []
    if measured.undefined_fraction:
        notes.append(f"white: {100 * measured.undefined_fraction:.2g} % undefined")
    n_spikes = np.count_nonzero(is_spike)
    if n_spikes:
        notes.append(f"dots: {counted(n_spikes, 'point')} in spikes")
    if notes:
        style: Any = {"ha": "left", "va": "bottom", "fontsize": 7, "color": "black"}
        style["bbox"] = {"facecolor": "white", "edgecolor": "none", "alpha": 0.85, "pad": 1.5}
        axes.annotate("; ".join(notes), (0.02, 0.02), xycoords="axes fraction", **style)
    i, j = np.nonzero(is_spike)
    unit, _ = length_unit(max(measured.size))
    x1 = (i + 0.5) * measured.spacing[0] / unit
    x2 = (j + 0.5) * measured.spacing[1] / unit
    points = (x2, x1) if is_turned(measured.size) else (x1, x2)
    limits = axes.get_xlim(), axes.get_ylim()
    axes.plot(*points, "o", color="#D55E00", mec="white", mew=0.3, ms=2.5)
    axes.set(xlim=limits[0], ylim=limits[1])


def _draw_histogram(axes: Axes, measured: Topography) -> None:
    """Draw the probability density of the heights, measured from their mean, on a logarithmic axis."""
    axes.set(xlabel="height [µm]", ylabel="probability\ndensity [1/µm]")
    z = measured.heights[~np.isnan(measured.heights)] * 1e6
    if not z.size:
        return
    density, edges = np.histogram(z - z.mean(), bins=200, density=True)
    axes.stairs(density, edges, fill=True, color=STYLES[1]["color"], alpha=0.75)
    axes.set_yscale("log")
    axes.set_ylim(density[density > 0].min() / 2, density.max() * 3)
    label_decades(axes.yaxis)
    add_grid(axes)


def _draw_radial_density(
    axes: Axes, complete: Topography, report: SurfaceReport, conditioning: Conditioning | None
) -> None:
    """Draw the spectral density averaged over directions.

    The panel also shows the fitted power law, the shortest measured wavelength, and the cut-off wavelength of the
    low-pass filter that a run applies.
    """
    q, density = complete.radial_psd()
    is_drawn = (q > 0) & (density > density.max(initial=0.0) * 1e-14)
    axes.loglog(_wavelength_um(q[is_drawn]), density[is_drawn], color=GREY, lw=0.8)
    if report.power_law is not None:
        q_ends = 2 * pi / np.array(report.power_law)
        # a self-affine surface with the Hurst exponent H has the density C(q) ~ q^(-2 - 2 H)
        fit = report.power_law_density * (q_ends / q_ends[0]) ** (-2 - 2 * report.hurst)
        exponent, error = report.power_law_slope
        label = f"$q^{{{exponent:.2f}\\,\\pm\\,{error:.2f}}}$, $H$ = {report.hurst:.2f}"
        axes.loglog(_wavelength_um(q_ends), fit, color=STYLES[0]["color"], lw=1.8, label=label)
    if conditioning is not None:
        _mark_wavelength(axes, conditioning.shortest_wave, "low-pass of a run", 2)
    _mark_wavelength(axes, report.shortest_wave, "shortest wave measured", 3)
    axes.set(xlabel=_WAVELENGTH, ylabel="spectral density, mean\nover directions [m⁴]")
    axes.xaxis.set_inverted(True)
    label_decades(axes.xaxis)
    label_decades(axes.yaxis)
    add_grid(axes)
    axes.legend(loc="lower left", fontsize=6.5)


def _mark_wavelength(axes: Axes, wavelength: float, name: str, style: int) -> None:
    """Draw a vertical line at a wavelength [m], with its name and value in the legend."""
    label = f"{name}, {to_text(wavelength, 'm', 3)}"
    axes.axvline(1e6 * wavelength, lw=1.0, label=label, **STYLES[style])
