"""Picture of a measured face: map, heights, spectral densities."""

from __future__ import annotations

from math import isnan, pi
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..base.quantities import to_text
from ..topography import SPIKES, Conditioning, SurfaceReport, Topography
from .drawing import STYLES, new_figure
from .height_map import height_panel

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_GREY = "#666666"
#: More spikes than these are dots: circles would hide the map.
_MOST_CIRCLES = 30


def survey_figure(
    topography: Topography,
    report: SurfaceReport | None = None,
    conditioning: Conditioning | None = None,
    *,
    part: tuple[float, float, float, float] | None = None,
    detrend: int = 1,
    spikes: float = SPIKES,
) -> Figure:
    """Levelled map with undefined points and spikes, histogram of heights, radial and profile spectral densities.

    Parameters
    ----------
    topography : as measured.
    report, conditioning : of the same map, or of its `part`, from `describe_surface` and `condition`; None is unknown.
    part : x1 from, to, x2 from, to [m] of the part that is described; None is the whole.
    detrend, spikes : as given to these.
    """
    figure = new_figure(11.0, 8.0)
    (image, histogram), (radial, profiles) = figure.subplots(2, 2)
    marked = topography.without_spikes(spikes)
    measured = topography if topography.undefined_share == 1 else topography.detrend(detrend)
    _map_panel(image, measured, np.isnan(marked.heights) & ~np.isnan(topography.heights), part)
    _histogram_panel(histogram, measured)
    if report is not None:
        flat = (marked if part is None else marked.crop_to(part)).fill_undefined(1.0).detrend(detrend)
        _radial_panel(radial, flat, report, conditioning)
        _profiles_panel(profiles, flat)
    for axes in (histogram, radial, profiles):
        axes.grid(alpha=0.25, lw=0.6)
        axes.tick_params(labelsize=8)
    return figure


def _map_panel(
    axes: Axes, measured: Topography, spikes: NDArray[np.bool_], part: tuple[float, float, float, float] | None
) -> None:
    from matplotlib.patches import Rectangle

    notes = []
    if measured.undefined_share:
        notes.append(f"white: {100 * measured.undefined_share:.2g} % undefined")
    if count := np.count_nonzero(spikes):
        notes.append(f"{'circles' if count <= _MOST_CIRCLES else 'dots'}: {count} points in spikes")
    if part is not None:
        notes.append("frame: largest part with few of them")
    l1, l2 = (length * 1e3 for length in measured.size)
    height_panel(axes, measured.heights * 1e6, (l1, l2), "; ".join(["levelled height [µm]", *notes]))
    if count:
        x1, x2 = ((k + 0.5) * d * 1e3 for k, d in zip(np.nonzero(spikes), measured.spacing, strict=True))
        if count <= _MOST_CIRCLES:
            axes.plot(x2, x1, "o", mfc="none", mec="#D55E00", ms=8)
        else:
            axes.plot(x2, x1, "o", color="black", ms=0.9, mew=0)
    if part is not None:
        from1, to1, from2, to2 = (end * 1e3 for end in part)
        axes.add_patch(Rectangle((from2, from1), to2 - from2, to1 - from1, fill=False, ec="black", ls="--", lw=1.3))
    axes.set(xlim=(0, l2), ylim=(0, l1))


def _profiles_panel(axes: Axes, flat: Topography) -> None:
    for axis in (0, 1):
        q, density = flat.psd(axis)
        shown = (q > 0) & (density > density.max() * 1e-12)
        colour, style, _ = STYLES[axis]
        label = ("along x1 (leakage)", "along x2")[axis]
        axes.loglog(q[shown], density[shown], color=colour, ls=style, lw=1.0, label=label)
    axes.set(xlabel="wavenumber q = 2π/λ [rad/m]", ylabel="spectral density [m³]")
    axes.set_title("mean spectral density of profiles", fontsize=9.5)
    axes.legend(fontsize=8, frameon=False)


def _histogram_panel(axes: Axes, measured: Topography) -> None:
    axes.set(xlabel="height [µm]", ylabel="probability density [1/µm]")
    axes.set_title("heights", fontsize=9.5)
    z = measured.heights[~np.isnan(measured.heights)] * 1e6
    if not z.size:
        return
    z = z - z.mean()
    share, edges = np.histogram(z, bins=200, density=True)
    axes.stairs(share, edges, fill=True, color=STYLES[1][0], alpha=0.75)
    if (sq := z.std()) > 0:
        x = np.linspace(edges[0], edges[-1], 400)
        axes.plot(x, np.exp(-((x / sq) ** 2) / 2) / (sq * np.sqrt(2 * pi)), "k--", lw=1.1, label="normal, same Sq")
        axes.legend(fontsize=8, frameon=False)
    axes.set_yscale("log")
    axes.set_ylim(float(np.min(share[share > 0])) / 2, float(np.max(share)) * 3)


def _radial_panel(axes: Axes, flat: Topography, report: SurfaceReport, conditioning: Conditioning | None) -> None:
    q, density = flat.radial_psd()
    shown = (q > 0) & (density > density.max(initial=0.0) * 1e-14)
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
    marks = [(report.shortest_wave, STYLES[3], "shortest wave measured")]
    if conditioning is not None:
        marks.insert(0, (conditioning.shortest_wavelength, STYLES[2], "low-pass of a run"))
    for wave, (colour, style, _), label in marks:
        axes.axvline(2 * pi / wave, color=colour, ls=style, lw=1.3, label=f"{label}, {to_text(wave, 'm', 3)}")
    axes.set(xlabel="wavenumber q = 2π/λ [rad/m]", ylabel="spectral density [m⁴]")
    axes.set_title("spectral density averaged over directions", fontsize=9.5)
    axes.legend(fontsize=8, framealpha=0.9, edgecolor="none")
