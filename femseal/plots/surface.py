"""Picture of a measured face: map, heights, spectral densities."""

from __future__ import annotations

from math import isnan, pi
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..base.quantities import to_text
from ..topography import SPIKES, Conditioning, SurfaceReport, Topography
from .drawing import STYLES, new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_GREY = "#666666"


def survey_figure(
    topography: Topography,
    report: SurfaceReport,
    conditioning: Conditioning,
    *,
    detrend: int = 1,
    spikes: float = SPIKES,
) -> Figure:
    """Levelled map with undefined points and spikes, histogram of heights, radial and profile spectral densities.

    Parameters
    ----------
    topography : as measured.
    report, conditioning : of the same map, from `describe_surface` and `condition`.
    detrend, spikes : as given to these.
    """
    marked = topography.without_spikes(spikes)
    measured = topography.detrend(detrend)
    flat = marked.fill_undefined(1.0).detrend(detrend)
    figure = new_figure(11.0, 8.0)
    (image, histogram), (radial, profiles) = figure.subplots(2, 2)
    _map_panel(image, measured, np.isnan(marked.heights) & ~np.isnan(topography.heights))
    _histogram_panel(histogram, measured)
    _radial_panel(radial, flat, report, conditioning)
    for axis in (0, 1):
        q, density = flat.psd(axis)
        shown = (q > 0) & (density > density.max() * 1e-12)
        colour, style, _ = STYLES[axis]
        label = ("along x1 (leakage)", "along x2")[axis]
        profiles.loglog(q[shown], density[shown], color=colour, ls=style, lw=1.0, label=label)
    profiles.set(xlabel="wavenumber q = 2π/λ [rad/m]", ylabel="spectral density [m³]")
    profiles.set_title("mean spectral density of profiles", fontsize=9.5)
    profiles.legend(fontsize=8, frameon=False)
    for axes in (histogram, radial, profiles):
        axes.grid(alpha=0.25, lw=0.6)
        axes.tick_params(labelsize=8)
    return figure


def _map_panel(axes: Axes, measured: Topography, spikes: NDArray[np.bool_]) -> None:
    z = measured.heights * 1e6
    # a few outliers must not take all the colours
    low, high = (float(v) for v in np.nanpercentile(z, (0.05, 99.95)))
    l1, l2 = (length * 1e3 for length in measured.size)
    image = axes.imshow(z, origin="lower", extent=(0, l2, 0, l1), vmin=low, vmax=high, interpolation="nearest")
    bar = axes.get_figure().colorbar(image, cax=axes.inset_axes((1.02, 0, 0.03, 1)))  # type: ignore[union-attr]
    bar.ax.tick_params(labelsize=8)
    axes.tick_params(labelsize=8)
    notes = []
    if measured.undefined_share:
        notes.append(f"white: {100 * measured.undefined_share:.2g} % undefined")
    if spikes.any():
        i, j = np.nonzero(spikes)
        x2, x1 = ((k + 0.5) * d * 1e3 for k, d in ((j, measured.spacing[1]), (i, measured.spacing[0])))
        axes.plot(x2, x1, "o", mfc="none", mec="#D55E00", ms=8)
        notes.append(f"circles: {np.count_nonzero(spikes)} points in spikes")
    axes.set(xlabel="x2 along the seal [mm]", ylabel="x1, inlet at 0 [mm]", aspect="equal")
    axes.set_title("; ".join(["levelled height [µm]", *notes]), fontsize=9.5)


def _histogram_panel(axes: Axes, measured: Topography) -> None:
    z = measured.heights[~np.isnan(measured.heights)] * 1e6
    z = z - z.mean()
    share, edges = np.histogram(z, bins=200, density=True)
    axes.stairs(share, edges, fill=True, color=STYLES[1][0], alpha=0.75)
    if (sq := z.std()) > 0:
        x = np.linspace(edges[0], edges[-1], 400)
        axes.plot(x, np.exp(-((x / sq) ** 2) / 2) / (sq * np.sqrt(2 * pi)), "k--", lw=1.1, label="normal, same Sq")
        axes.legend(fontsize=8, frameon=False)
    axes.set_yscale("log")
    axes.set_ylim(float(np.min(share[share > 0])) / 2, float(np.max(share)) * 3)
    axes.set(xlabel="height [µm]", ylabel="probability density [1/µm]")
    axes.set_title("heights", fontsize=9.5)


def _radial_panel(axes: Axes, flat: Topography, report: SurfaceReport, conditioning: Conditioning) -> None:
    q, density = flat.radial_psd()
    shown = (q > 0) & (density > density.max() * 1e-14)
    axes.loglog(q[shown], density[shown], color=_GREY, lw=1.0)
    if report.noise:
        floor = report.noise**2 * flat.spacing[0] * flat.spacing[1]
        axes.axhline(floor, color=_GREY, ls=":", lw=1.1, label=f"white noise, {to_text(report.noise, 'm', 3)} rms")
    if report.power_law is not None:
        ends = 2 * pi / np.array(report.power_law)
        law = report.power_law_density * (ends / ends[0]) ** (-2 - 2 * report.hurst)
        label = f"q^(−2−2H), H = {report.hurst:.2f}"
        axes.loglog(ends, law, color=STYLES[0][0], lw=2.2, label=label)
        if not isnan(report.roll_off):
            axes.loglog((q[shown][0], ends[0]), (law[0], law[0]), color=STYLES[0][0], lw=2.2, ls="--",
                        label=f"plateau beyond {to_text(report.roll_off, 'm', 3)}")  # fmt: skip
    marks = ((conditioning.shortest_wavelength, STYLES[2], "low-pass of a run"),
             (report.shortest_wave, STYLES[3], "shortest wave measured"))  # fmt: skip
    for wave, (colour, style, _), label in marks:
        axes.axvline(2 * pi / wave, color=colour, ls=style, lw=1.3, label=f"{label}, {to_text(wave, 'm', 3)}")
    axes.set(xlabel="wavenumber q = 2π/λ [rad/m]", ylabel="spectral density [m⁴]")
    axes.set_title("spectral density averaged over directions", fontsize=9.5)
    axes.legend(fontsize=8, framealpha=0.9, edgecolor="none")
