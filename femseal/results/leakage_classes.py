"""Leakage classes in a dataset: which are met at each load step, by the leakage of the fluid that decides."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..base import Array, to_text
from ..base.fields import LEAK_CLASS
from ..base.leak_rates import LeakBasis, LeakClass, leak_classes, within
from .variables import add_coordinate, add_new

if TYPE_CHECKING:
    import xarray

#: Ratio of the length of a seal to the circumference of its nominal diameter beyond which a warning is given.
_ODD_LENGTH_RATIO = 1.5


@dataclass(frozen=True, eq=False)
class DecidingLeakage:
    """The leakage that decides on classes, of the test fluid if there is one.

    Attributes
    ----------
    basis : length of the seal, and reference state of the fluid.
    leakage : (step,) [m²/s], NaN where it is not known.
    of_realisations : (realisation, step) [m²/s].
    upper : upper end of the 95 % interval (step,) [m²/s], NaN if unknown; None without an error budget.
    """

    basis: LeakBasis
    leakage: Array
    of_realisations: Array
    upper: Array | None


def add_classes(
    data: xarray.Dataset,
    classes: Sequence[LeakClass],
    deciding: DecidingLeakage,
    diameter: float | None,
) -> list[str]:
    """Add which classes are met at each step, and by which fraction of the realisations.

    A class is open at a step without computed leakage whose interval has no upper end: it is neither met nor not met.

    Parameters
    ----------
    data : dataset that is extended.
    classes : the leakage classes.
    deciding : the leakage that decides.
    diameter : nominal diameter [m], which some classes need.

    Returns
    -------
    Warnings.

    Raises
    ------
    InputError : a class needs a diameter and has none, or is not for the fluid.
    """
    if diameter is not None:
        data.attrs["nominal_diameter_m"] = float(diameter)
    if not classes:
        return []
    limits = np.array([leak_class.limit(deciding.basis, diameter) for leak_class in classes])
    add_coordinate(
        data, "leak_class", "1", "leakage class", [leak_class.name for leak_class in classes]
    )
    text = "largest leakage per unit seal length in the class, of the fluid that decides on it"
    add_new(data, "class_limit", "m^2/s", text, limits, ("leak_class",))
    text = "1 where the leakage given meets the class, 0 where not or failed, NaN: open"
    add_new(data, "class_met", "1", text, _is_met(limits, deciding), LEAK_CLASS)
    text = "fraction of the realisations that meet the class, NaN: open or failed"
    add_new(data, "class_fraction", "1", text, _fraction_met(limits, deciding), LEAK_CLASS)
    return _warnings(classes, deciding.basis.length, diameter)


def _is_met(limits: Array, deciding: DecidingLeakage) -> Array:
    """Return 1 where the leakage is within a limit, 0 where not, NaN where this is open (leak_class, step)."""
    is_met = np.array([within(deciding.leakage, limit) for limit in limits]).astype(float)
    if deciding.upper is not None:
        is_open = (deciding.leakage == 0) & ~np.isfinite(deciding.upper)
        is_met[:, is_open] = np.nan
    return is_met


def _fraction_met(limits: Array, deciding: DecidingLeakage) -> Array:
    """Return the fraction of the realisations within each limit (leak_class, step), NaN where open or failed."""
    leakage = deciding.of_realisations
    is_known = np.isfinite(leakage)
    known = np.maximum(is_known.sum(axis=0), 1)
    counts = [(within(leakage, limit) & is_known).sum(axis=0) for limit in limits]
    fraction = np.array(counts) / known
    is_missing = ~is_known.any(axis=0) | np.isnan(deciding.leakage)
    if deciding.upper is not None:
        is_missing |= (leakage == 0).any(axis=0) & ~np.isfinite(deciding.upper)
    fraction[:, is_missing] = np.nan
    return fraction


def _warnings(classes: Sequence[LeakClass], length: float, diameter: float | None) -> list[str]:
    """Return warnings of limits from secondary sources, and of a diameter that does not suit the length of the seal."""
    warnings = []
    secondary = [f"{item.name} ({item.edition})" for item in classes if item.second_hand]
    if secondary:
        warnings.append(
            f"The limits of {', '.join(secondary)} are from tables of others, not from the text of the standard: "
            "compare them with the standard before you rely on them."
        )
    if diameter is None or not any(leak_class.per_diameter for leak_class in classes):
        return warnings
    circumference = np.pi * diameter
    ratio = length / circumference
    if not 1 / _ODD_LENGTH_RATIO <= ratio <= _ODD_LENGTH_RATIO:
        warnings.append(
            "Leakage classes by nominal diameter may be judged wrongly, as they are of the whole seal: it is "
            f"{to_text(length, 'm', 3)} long, but a seat of {to_text(diameter, 'm', 3)} is about "
            f"{to_text(circumference, 'm', 3)} long. Check the length of the seal and nominal_diameter."
        )
    return warnings


def tightest_classes(data: xarray.Dataset) -> list[str]:
    """Return the tightest class of each standard that is met at each step, [] without classes.

    The text of a step is "none" if no class is met, "failed" if the computation failed, and "open" if no leakage was
    computed but its 95 % interval has no upper end.
    """
    if "leak_class" not in data.coords:
        return []
    classes = leak_classes(data["leak_class"].values.tolist())
    from_widest = np.argsort(data["class_limit"].values, kind="stable")[::-1]
    texts = []
    for is_met, fraction in zip(
        data["class_met"].values.T, data["class_fraction"].values.T, strict=True
    ):
        if np.isnan(is_met).any():
            texts.append("open")
            continue
        if np.isnan(fraction).all():
            texts.append("failed")
            continue
        tightest: dict[str, str] = {}
        for number in from_widest:
            leak_class = classes[number]
            if is_met[number]:
                # later ones are tighter
                tightest[leak_class.family or leak_class.name] = leak_class.name
        texts.append(", ".join(tightest.values()) or "none")
    return texts
