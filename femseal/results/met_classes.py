"""Compare the leakage at each load step with the limits of leakage classes, and store the outcome in a dataset.

If the case has a test fluid, the leakage of the test fluid is compared with the limits. Without a test fluid, the
leakage of the service fluid is compared with the limits.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from ..base import Array, to_text
from ..base.fields import LEAK_CLASS
from ..base.leak_classes import USUAL_CLASSES, LeakClass, find_leak_classes, within
from .best_leakage import (
    best_budget,
    class_basis_of,
    class_leakage_of,
    class_leakage_of_realisations,
    failed_steps,
)
from .variables import add_coordinate, add_new

if TYPE_CHECKING:
    import xarray

#: Largest factor by which the seal length may differ from the circumference of its nominal diameter without a warning.
_ODD_LENGTH_RATIO = 1.5


def add_classes(
    data: xarray.Dataset, classes: Sequence[LeakClass], diameter: float | None
) -> list[str]:
    """Add variables that say which classes are met at each step, and which fraction of the realisations meets them.

    If the computed leakage is zero but its 95 % interval has no upper end, it is undecided whether a class is met. If
    the computation failed for the service fluid or for the test fluid, no class is met.

    Parameters
    ----------
    data : dataset that is extended.
    classes : leakage classes to check.
    diameter : nominal diameter [m], on which the limits of some classes depend; None if unknown.

    Returns
    -------
    Warnings about the classes.

    Raises
    ------
    InputError : a class needs a nominal diameter but `diameter` is None, or a class does not suit the fluid.
    """
    if diameter is not None:
        data.attrs["nominal_diameter_m"] = float(diameter)
    if not classes:
        return []
    basis = class_basis_of(data)
    limits = np.array([leak_class.limit(basis, diameter) for leak_class in classes])
    leakage = np.where(failed_steps(data), np.nan, class_leakage_of(data))
    of_realisations = class_leakage_of_realisations(data)
    budget = best_budget(data)
    # without an error budget, the leakage counts as known
    upper = np.zeros_like(leakage) if budget is None else budget.upper
    names = [leak_class.name for leak_class in classes]
    add_coordinate(data, "leak_class", "1", "leakage class", names)
    text = "largest leakage per unit seal length that the class allows, for the fluid to which it is applied"
    add_new(data, "class_limit", "m^2/s", text, limits, ("leak_class",))
    text = "1 where the leakage meets the class, 0 where it does not or is unknown, NaN: undecided"
    add_new(data, "class_met", "1", text, _is_met(limits, leakage, upper), LEAK_CLASS)
    text = "fraction of the realisations that meet the class, NaN: undecided or unknown"
    fraction = _fraction_met(limits, leakage, of_realisations, upper)
    add_new(data, "class_fraction", "1", text, fraction, LEAK_CLASS)
    return _warnings(classes, basis.length, diameter)


def class_limits(
    data: xarray.Dataset, classes: Sequence[LeakClass] = (), diameter: float | None = None
) -> dict[str, float]:
    """Return the largest leakage per length that each leakage class allows [m²/s], by the name of the class.

    Parameters
    ----------
    data : dataset of a run.
    classes : leakage classes; by default the classes of the run, or `USUAL_CLASSES` for a run without classes.
    diameter : nominal diameter [m]; by default the nominal diameter of the run.
    """
    if not classes:
        has_classes = "leak_class" in data.coords
        classes = find_leak_classes(
            data["leak_class"].values.tolist() if has_classes else USUAL_CLASSES
        )
    diameter = diameter or data.attrs.get("nominal_diameter_m")
    basis = class_basis_of(data)
    return {leak_class.name: leak_class.limit(basis, diameter) for leak_class in classes}


def _is_met(limits: Array, leakage: Array, upper: Array) -> Array:
    """Return whether the leakage is within each limit: 1 if yes, 0 if no, NaN if undecided; (leak_class, step).

    Parameters
    ----------
    limits : largest leakage per length in each class [m²/s].
    leakage : leakage per unit seal length, (step,) [m²/s], NaN where unknown.
    upper : upper end of the 95 % interval of the leakage, (step,) [m²/s], NaN where unknown.
    """
    is_met = np.array([within(leakage, limit) for limit in limits]).astype(float)
    is_met[:, (leakage == 0) & ~np.isfinite(upper)] = np.nan
    return is_met


def _fraction_met(limits: Array, leakage: Array, of_realisations: Array, upper: Array) -> Array:
    """Return the fraction of the realisations whose leakage is within each limit, (leak_class, step).

    The fraction is NaN at steps where it is unknown whether a realisation leaks, and at steps where the
    computation failed. The leakage of each realisation is an array (realisation, step) [m²/s]; see `_is_met` for the
    other arguments.
    """
    is_known = np.isfinite(of_realisations)
    known_count = np.maximum(is_known.sum(axis=0), 1)  # at least 1, so as not to divide by 0
    met_counts = [(within(of_realisations, limit) & is_known).sum(axis=0) for limit in limits]
    fraction = np.array(met_counts) / known_count
    is_missing = ~is_known.any(axis=0) | np.isnan(leakage)
    # where the interval has no upper end, a realisation that is computed as sealed may leak any amount
    is_missing |= (of_realisations == 0).any(axis=0) & ~np.isfinite(upper)
    fraction[:, is_missing] = np.nan
    return fraction


def _warnings(classes: Sequence[LeakClass], length: float, diameter: float | None) -> list[str]:
    """Return warnings about limits that come from secondary sources, and about a contradictory nominal diameter.

    Parameters
    ----------
    classes : leakage classes that are checked.
    length : seal length [m].
    diameter : nominal diameter [m], None if unknown. The diameter is contradictory if a circle with this diameter is
        much longer or shorter than the seal.
    """
    warnings = []
    secondary = [
        f"{leak_class.name} ({leak_class.edition})"
        for leak_class in classes
        if leak_class.second_hand
    ]
    if secondary:
        warnings.append(
            f"The limits of {', '.join(secondary)} come from secondary sources, not from the text of the standard: "
            "compare them with the standard before you rely on them."
        )
    if diameter is None or not any(leak_class.per_diameter for leak_class in classes):
        return warnings
    circumference = np.pi * diameter
    ratio = length / circumference
    if not 1 / _ODD_LENGTH_RATIO <= ratio <= _ODD_LENGTH_RATIO:
        warnings.append(
            "Leakage classes that depend on the nominal diameter may be judged wrongly. Their limits are for the whole "
            f"seal, which is {to_text(length, 'm', 3)} long here, but a seat of {to_text(diameter, 'm', 3)} is about "
            f"{to_text(circumference, 'm', 3)} long. Check the length of the seal and nominal_diameter."
        )
    return warnings


def tightest_classes(data: xarray.Dataset) -> list[str]:
    """Return a string for each step that lists, for each standard, the tightest class that is met.

    The text of a step is "none" if no class is met, "failed" if the computation failed, and "open" if the computed
    leakage is zero but its 95 % interval has no upper end. The function returns an empty list if no classes were
    checked.
    """
    if "leak_class" not in data.coords:
        return []
    classes = find_leak_classes(data["leak_class"].values.tolist())
    # in this order, a tighter class comes after a wider class
    largest_limit_first = np.argsort(data["class_limit"].values, kind="stable")[::-1]
    met_by_step = data["class_met"].values.T  # (step, leak_class)
    fraction_by_step = data["class_fraction"].values.T
    texts = []
    for is_met, fraction in zip(met_by_step, fraction_by_step, strict=True):
        if np.isnan(is_met).any():
            texts.append("open")
        elif np.isnan(fraction).all():
            texts.append("failed")
        else:
            # class that is met, by standard; a tighter class replaces a wider class of the same standard
            tightest: dict[str, str] = {}
            for number in largest_limit_first:
                leak_class = classes[number]
                if is_met[number]:
                    tightest[leak_class.family or leak_class.name] = leak_class.name
            texts.append(", ".join(tightest.values()) or "none")
    return texts
