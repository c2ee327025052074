"""Scales of axes: loads spread over the width, and decades with plain labels."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..base.arrays import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis

#: Least distance of two labels of loads, as a fraction of the axis.
_APART = 0.09
#: Part of the axis between a load of 0 and the least one above it, in decades.
_ZERO_DECADES = 0.4
#: Ratio of the ends of an axis beyond which it has no ticks between the powers of ten.
_FINE = 1e5
_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
#: Powers of ten that are written as numbers.
_PLAIN = range(-2, 4)


def load_axis(axes: Axes, loads: Array) -> None:
    """Scale of the x axis over loads: linear or logarithmic, whichever keeps the closest two further apart.

    A load of 0 stands left of the others on the logarithmic scale.
    """
    loads = np.unique(loads[np.isfinite(loads) & (loads >= 0)])
    if not loads.size or not loads[-1] > 0:
        return
    if not _spread(places := _log_places(loads)) > _spread(np.unique(np.r_[0.0, loads])):
        axes.set_xlim(0, loads[-1] * 1.03)
        return
    positive = loads[loads > 0]
    margin = 0.03 * (places[-1] - places[0])
    if loads[0] > 0:
        axes.set_xscale("log")
        axes.set_xlim(loads[0] / 10**margin, loads[-1] * 10**margin)
    else:
        axes.set_xscale("symlog", linthresh=positive[0], linscale=_ZERO_DECADES, subs=[])
        axes.set_xlim(-positive[0] * margin / _ZERO_DECADES, loads[-1] * 10**margin)
    # from both ends inwards, so that the least and the highest load have a label
    kept: list[int] = []
    for n in sorted(range(loads.size), key=lambda n: (min(n, loads.size - 1 - n) > 0, -n)):
        if all(abs(places[n] - places[k]) >= _APART * (places[-1] - places[0]) for k in kept):
            kept.append(n)
    axes.set_xticks(loads[sorted(kept)], labels=[f"{loads[n]:.4g}" for n in sorted(kept)])
    axes.set_xticks(loads, labels=[""] * loads.size, minor=True)


def _log_places(loads: Array) -> Array:
    """Places of the loads on the logarithmic scale [decades]."""
    positive = np.log10(loads[loads > 0])
    return positive if loads[0] > 0 else np.r_[positive[0] - _ZERO_DECADES, positive]


def _spread(places: Array) -> float:
    """The least distance of two loads as a fraction of the axis; of a single load 0."""
    width = places[-1] - places[0]
    return float(np.diff(places).min() / width) if width > 0 else 0.0


def decades(axis: Axis) -> None:
    """Label the powers of ten of a logarithmic axis without the parser of formulas, which is slow."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter, NullLocator

    low, high = axis.get_view_interval()
    axis.set_major_formatter(FuncFormatter(lambda value, _: power_text(value)))
    if high / low < 30:
        axis.set_minor_locator(LogLocator(subs=(2, 5)))
        axis.set_minor_formatter(FuncFormatter(lambda value, _: _number_text(value)))
    else:
        axis.set_minor_formatter(NullFormatter())
        if high / low > _FINE:
            axis.set_minor_locator(NullLocator())


def power_text(value: float) -> str:
    """A power of ten as text.

    >>> power_text(1e-12), power_text(100.0)
    ('10⁻¹²', '100')
    """
    exponent = round(np.log10(value))
    return f"{value:g}" if exponent in _PLAIN else f"10{str(exponent).translate(_SUPERSCRIPTS)}"


def _number_text(value: float) -> str:
    exponent = int(np.floor(np.log10(value) + 1e-9))
    if exponent in _PLAIN:
        return f"{value:g}"
    return f"{value / 10.0**exponent:.0f}·10{str(exponent).translate(_SUPERSCRIPTS)}"
