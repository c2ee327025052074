"""Description of a measured face: size, heights, slopes, texture and spectrum.

Source: ISO 25178-2 (Sq, Sa, Sz, Ssk, Sku, Sal, Str, Std), ISO 21920-2 (Ra, Rz, Rq, Rsk).
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from math import atan, degrees, isnan, nan
from typing import Any

import numpy as np

from ..base.quantities import to_text
from .form import fit_form
from .power_law import spectrum
from .repair import repair
from .roughness import roughness
from .spikes import SPIKES
from .texture import texture
from .topography import Topography


class Labelled:
    """Base of dataclasses whose fields carry `unit`, `label`, and `percent` for fractions: a line of text for each."""

    def __str__(self) -> str:
        metadata = {f.name: f.metadata for f in fields(self)}  # type: ignore[arg-type]
        width = max(len(m["label"]) for m in metadata.values())
        return "\n".join(f"{m['label']:{width}}  {as_text(getattr(self, name), **m)}" for name, m in metadata.items())


def as_text(value: Any, unit: str, *, percent: bool = False, joint: str = "", **_: Any) -> str:
    """A value in SI for people: angles in degrees, fractions in per cent, None and NaN as a dash; `joint` between two.

    >>> as_text((1e-6, 2e-6), "m"), as_text(0.5, "rad"), as_text(0.0023, "", percent=True)
    ('1 µm × 2 µm', '28.65°', '0.23 %')
    """
    if isinstance(value, tuple):
        joint = joint or (" × " if unit == "m" or isinstance(value[0], int) else ", ")
        return joint.join(as_text(v, unit, percent=percent) for v in value)
    if value is None or (isinstance(value, float) and isnan(value)):
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int):
        return str(value)
    if percent:
        return f"{100 * value:.3g} %"
    if unit == "rad":
        return f"{degrees(value):.4g}°"
    return to_text(value, unit) if unit == "m" else f"{value:.4g} {unit}".strip()


@dataclass(frozen=True)
class SurfaceReport(Labelled):
    """Numbers of a map after levelling; NaN and None mark numbers that the face does not have.

    Heights are those of the defined points, spikes included, as instruments count them. Slopes, texture and spectrum
    are those of the map without spikes, with undefined points filled, and so are parameters behind the Gaussian filters
    (`roughness.py`). Angles are counted from x1 towards x2.
    """

    shape: tuple[int, int] = field(metadata={"unit": "", "label": "points"})
    size: tuple[float, float] = field(metadata={"unit": "m", "label": "size"})
    spacing: tuple[float, float] = field(metadata={"unit": "m", "label": "pixel"})
    undefined_fraction: float = field(metadata={"unit": "", "label": "undefined points", "percent": True})
    spikes: int = field(metadata={"unit": "", "label": "points in spikes"})
    tilt: tuple[float, float] = field(metadata={"unit": "rad", "label": "tilt along x1 (leakage), x2"})
    rms_height: float = field(metadata={"unit": "m", "label": "Sq, rms height"})
    mean_height: float = field(metadata={"unit": "m", "label": "Sa, arithmetic mean height"})
    peak_to_valley: float = field(metadata={"unit": "m", "label": "Sz, highest to lowest point"})
    skewness: float = field(metadata={"unit": "", "label": "Ssk, skewness"})
    kurtosis: float = field(metadata={"unit": "", "label": "Sku, kurtosis"})
    rms_slope: float = field(metadata={"unit": "", "label": "rms slope"})
    rms_slopes: tuple[float, float] = field(metadata={"unit": "", "label": "rms slopes along x1, x2"})
    correlation_length: float = field(metadata={"unit": "m", "label": "Sal, autocorrelation length"})
    aspect_ratio: float = field(metadata={"unit": "", "label": "Str, texture aspect ratio"})
    aspect_ratio_is_bound: bool = field(metadata={"unit": "", "label": "Str only a bound: lay as long as map"})
    lay_direction: float = field(metadata={"unit": "rad", "label": "Std, lay from x2 (Str <= 0.5)"})
    shortest_wave: float = field(metadata={"unit": "m", "label": "shortest wave above noise, cut-off"})
    noise: float = field(metadata={"unit": "m", "label": "white noise, rms"})
    hurst: float = field(metadata={"unit": "", "label": "Hurst exponent of the power law"})
    power_law_slope: tuple[float, float] = field(
        metadata={"unit": "", "label": "its slope, log C over log q", "joint": " ± "}
    )
    power_law: tuple[float, float] | None = field(
        metadata={"unit": "m", "label": "longest, shortest wave of the law", "joint": ", "}
    )
    power_law_density: float = field(metadata={"unit": "m^4", "label": "spectral density at its longest wave"})
    roll_off: float = field(metadata={"unit": "m", "label": "roll-off: end of a plateau"})
    profile_cut_off: tuple[float, float] = field(metadata={"unit": "m", "label": "cut-offs of profiles", "joint": ", "})
    ra: tuple[float, float] = field(metadata={"unit": "m", "label": "Ra of profiles along x1, x2", "joint": ", "})
    rz: tuple[float, float] = field(metadata={"unit": "m", "label": "Rz", "joint": ", "})
    rq: tuple[float, float] = field(metadata={"unit": "m", "label": "Rq", "joint": ", "})
    rsk: tuple[float, float] = field(metadata={"unit": "", "label": "Rsk", "joint": ", "})
    sa: float = field(metadata={"unit": "m", "label": "Sa of the roughness, behind filters"})
    sz: float = field(metadata={"unit": "m", "label": "Sz of the roughness"})
    sq: float = field(metadata={"unit": "m", "label": "Sq of the roughness"})
    ssk: float = field(metadata={"unit": "", "label": "Ssk of the roughness"})


def describe_surface(
    topography: Topography, *, detrend: int = 1, spikes: float = SPIKES, max_undefined: float = 0.05
) -> SurfaceReport:
    """Describe a measured or generated map.

    Parameters
    ----------
    topography : the map as measured.
    detrend : order of the form taken off first: 0 mean, 1 tilt, 2 tilt and curvature.
    spikes : threshold of `find_spikes`; infinite looks for none.
    max_undefined : largest fraction of points (0 to 1) that may be filled for slopes, texture and spectrum.

    Raises
    ------
    InputError : too many undefined points; an order or a threshold that cannot be used.

    Examples
    --------
    >>> from femseal.topography import self_affine
    >>> report = describe_surface(self_affine((256, 256), (1e-3, 1e-3), hurst=0.8, rms_height=1e-6, rng=1))
    >>> round(report.hurst, 1), report.spikes, report.shape
    (0.8, 0, (256, 256))
    """
    flat, repaired = repair(topography, spikes=spikes, max_undefined=max_undefined, detrend=detrend)
    measured = topography.heights - fit_form(topography.heights, topography.size, detrend).heights
    z = measured[~np.isnan(measured)]
    z = z - z.mean()
    sq = float(z.std())
    tilt = fit_form(topography.heights, topography.size, max(detrend, 1)).slopes
    look, waves = texture(flat), spectrum(flat)
    law = waves.law
    return SurfaceReport(
        shape=topography.shape,
        size=topography.size,
        spacing=topography.spacing,
        undefined_fraction=repaired.undefined_fraction,
        spikes=repaired.spikes,
        tilt=(atan(tilt[0]), atan(tilt[1])),
        rms_height=sq,
        mean_height=float(np.abs(z).mean()),
        peak_to_valley=float(np.ptp(z)),
        skewness=float(np.mean(z**3)) / sq**3 if sq else nan,
        kurtosis=float(np.mean(z**4)) / sq**4 if sq else nan,
        rms_slope=flat.rms_slope,
        rms_slopes=flat.rms_slopes,
        correlation_length=look.correlation_length,
        aspect_ratio=look.aspect_ratio,
        aspect_ratio_is_bound=look.aspect_ratio_is_bound,
        lay_direction=look.lay_direction,
        shortest_wave=waves.shortest_wave,
        noise=waves.noise,
        hurst=law.hurst if law else nan,
        power_law=(law.longest, law.shortest) if law else None,
        power_law_density=law.density if law else nan,
        roll_off=law.roll_off if law else nan,
        power_law_slope=(-2 - 2 * law.hurst, 2 * law.hurst_error) if law else (nan, nan),
        **roughness(flat),
    )
