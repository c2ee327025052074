"""Parameters of classes that a case can choose, such as fluids, declared once with unit and range.

The class checks its values by `check_parameters`; the case file gets a key for each of them from the same metadata.
"""

from __future__ import annotations

from dataclasses import MISSING, field, fields
from typing import Any

from . import validate


def parameter(
    unit: str, allowed: str, *, above: float = 0.0, inclusive: bool = False, default: float | Any = MISSING
) -> Any:
    """A field of a dataclass: a finite number > `above`, or >= `above` where `inclusive`.

    unit : in SI, as text that case files may use too, such as "Pa*s".
    allowed : what a case file may give, with an example, such as "a viscosity > 0, such as '1 mPa*s'".
    default : value where none is given, which may be None; without it the parameter is required.
    """
    metadata = {"unit": unit, "allowed": allowed, "above": above, "inclusive": inclusive}
    return field(default=default, metadata=metadata)


def check_parameters(model: Any) -> None:
    """Check the parameters of a dataclass.

    Raises InputError: one of them is not a finite number, or is out of its range.
    """
    for f in fields(model):
        if "allowed" in f.metadata:
            if getattr(model, f.name) is None and f.default is None:
                continue
            unit = f.metadata["unit"].replace("*", " ").replace("^3", "³")
            above, inclusive = f.metadata["above"], f.metadata["inclusive"]
            validate.number(f.name, getattr(model, f.name), unit=unit, above=above, inclusive=inclusive)
