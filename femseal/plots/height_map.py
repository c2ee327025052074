"""Map of heights whose colours are for the many points: the few far above or below have colours of their own."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from .drawing import colour_bar

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: Percentiles between which the colours lie at least, and the share of their distance that is added at both ends.
_PERCENTILES = (0.5, 99.5)
_MARGIN = 0.25
#: Colours of points above and below the range, with their names.
ABOVE, BELOW = ("#E31A1C", "red"), ("#00D5FF", "light blue")


@dataclass(frozen=True)
class HeightRange:
    """Heights from `low` to `high` in the colours of a map, and the shares of the points `below` and `above`."""

    low: float
    high: float
    below: float
    above: float

    @property
    def text(self) -> str:
        """What the two colours stand for; "" where no point is out of range."""
        parts = ((self.above, ABOVE, "above"), (self.below, BELOW, "below"))
        return ", ".join(f"{name}: {_share(part)} {where}" for part, (_, name), where in parts if part)


def height_range(heights: NDArray) -> HeightRange:
    """Range that a few outliers do not widen: of all heights that are no farther than a margin from percentiles."""
    z = heights[~np.isnan(heights)]
    if not z.size:
        return HeightRange(0.0, 1.0, 0.0, 0.0)
    low, high = (float(v) for v in np.percentile(z, _PERCENTILES))
    margin = _MARGIN * (high - low)
    near = z[(z >= low - margin) & (z <= high + margin)]
    low, high = float(near.min()), float(near.max())
    if high == low:  # nearly all points at one height: nothing to spread but the outliers
        low, high = float(z.min()), float(z.max())
    return HeightRange(low, high, float(np.mean(z < low)), float(np.mean(z > high)))


def height_panel(axes: Axes, heights: NDArray, size: tuple[float, float], title: str = "height [µm]") -> None:
    """Map of heights (n1, n2) [µm] over a face of a size [mm]; the colour bar says what is out of its range.

    Undefined points are white.
    """
    from matplotlib import colormaps

    shown = height_range(heights)
    colours = colormaps["viridis"].with_extremes(over=ABOVE[0], under=BELOW[0], bad="white")
    image = axes.imshow(
        heights, origin="lower", extent=(0.0, size[1], 0.0, size[0]), cmap=colours, interpolation="nearest",
        vmin=shown.low, vmax=shown.high,
    )  # fmt: skip
    beyond = {(True, True): "both", (True, False): "min", (False, True): "max", (False, False): "neither"}
    bar = colour_bar(axes, image, extend=beyond[shown.below > 0, shown.above > 0])
    if shown.text:
        bar.set_label(shown.text, fontsize=8)
    axes.set_title(title, fontsize=9.5)
    axes.set(xlabel="x2 along the seal [mm]", ylabel="x1, inlet at 0 [mm]", aspect="equal")


def _share(part: float) -> str:
    return f"{100 * part:.2g} %"
