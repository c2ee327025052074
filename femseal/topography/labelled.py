"""Results whose fields carry their unit and label, as text for people."""

from __future__ import annotations

from dataclasses import fields
from math import degrees, isnan
from typing import Any

from ..base.quantities import to_text


class Labelled:
    """Base of dataclasses whose fields carry `unit` and `label`, and `percent` for shares: a line of text for each."""

    def __str__(self) -> str:
        metadata = {f.name: f.metadata for f in fields(self)}  # type: ignore[arg-type]
        width = max(len(m["label"]) for m in metadata.values())
        return "\n".join(f"{m['label']:{width}}  {as_text(getattr(self, name), **m)}" for name, m in metadata.items())


def as_text(value: Any, unit: str, *, percent: bool = False, joint: str = "", **_: Any) -> str:
    """A value in SI for people: angles in degrees, shares in per cent, None and NaN as a dash; `joint` between two.

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
