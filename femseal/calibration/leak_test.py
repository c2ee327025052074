"""A leak test, read from a file and checked against the case that it is of, and the posterior that it gives.

Posterior of hardness, shortest wave and factor by Bayes' rule, with a surrogate of the leakage. The test is the factor
times the model: ln(measured) is normal around ln(factor) + ln(model), with the error of the test, independent at each
row, and that of the surrogate, correlated between loads. A sealed row is one whose model is closed, or leaks less than
the limit. Priors are uniform in the logarithm within ranges.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.special import ndtr
from scipy.stats import qmc

from ..base import Array, Flags, InputError, InputErrors, counted, shortened, shown, to_si, to_text
from ..base.leak_units import LeakUnit, leak_unit
from ..case.case import Case
from ..case.quantity_types import Amount
from ..fluids import leak_basis
from ..loads import LoadProgramme, LoadStep
from ..seal.seal_files import text_rows
from .surrogate import Surrogate

COLUMNS = "pressure [MPa], leakage [mL/min]; and, if any row is of an unloading, branch, unloaded from [MPa]"
BRANCHES = ("loading", "unloading")
#: What a sealed row says, and how one below the detection limit begins.
SEALED, BELOW = "sealed", "<"
_HEAD = re.compile(r"\s*([^\[(]+?)\s*(?:[\[(]\s*(.*\S)\s*[\])])?\s*")
_COMMA = re.compile(r"\d+,\d+")
_NAMES = {"pressure": "load", "load": "load", "force": "load", "branch": "branch", "unloaded from": "peak",
          "leakage": "leakage"}  # fmt: skip


@dataclass(frozen=True, eq=False)
class LeakTest:
    """Measured leakages (rows,) of one seal.

    steps : load of each row in the unit of the loads of the case. leakage : in `unit`; of a sealed row, the limit below
    which it lies. sealed : which rows are sealed or below the detection limit.
    """

    steps: tuple[LoadStep, ...]
    leakage: Array
    sealed: Flags
    unit: LeakUnit

    def of_case(self, case: Case) -> Case:
        """The case at the loads of the test alone, without what the calibration does not need."""
        unit = case.load.unit
        peaks = sorted({s.unloaded_from for s in self.steps if s.unloaded_from is not None})
        loading = {s.pressure for s in self.steps if s.unloaded_from is None} or {*peaks}
        down = sorted({s.pressure for s in self.steps if s.unloaded_from is not None}, reverse=True)
        loads = {"loading": sorted(loading), "unload_from": peaks, "unloading": down}
        changed = {
            name: tuple(Amount(load, unit) for load in values) for name, values in loads.items()
        }
        load = case.load.model_copy(update=changed | {"relaxation": 0.0})
        left_out = dict.fromkeys(("budget", "pictures", "report", "fields"), False)
        output = case.output.model_copy(update={**left_out, "paraview": "none"})
        return case.model_copy(update={"output": output, "compare": (), "load": load})

    def rows_of(self, case: Case) -> list[int]:
        """Load step of each row in a run of `of_case`."""
        loads = self.of_case(case).load
        programme = LoadProgramme.of(loads.loading, loads.unload_from, loads.unloading)
        return [programme.index(step) for step in self.steps]


def read_leak_test(path: Path, case: Case) -> LeakTest:
    """Read a leak test of a case from a file with columns.

    The first line that is no comment (#) has the names of the columns with their units, `COLUMNS`, see `text_rows`. A
    leakage is a number, "sealed", or "< 0.1" below a detection limit; sealed rows without a limit leak less than the
    least that was measured.

    Raises InputError: the file cannot be read, a column or a unit is unknown or missing, or rows cannot be used: no
    number, no known branch, a load beyond those of the case; one line for each fault, with its line in the file.
    """
    (_, _, heads), *lines = text_rows(path, "data")
    if not lines:
        raise InputError("data", f"'{path}' without rows", f"a line of heads, {COLUMNS}, and rows")
    columns, unit = _columns(heads, case)
    rows, faults = [], []
    for number, _, row in lines:
        try:
            if len(row) != len(heads):
                raise InputError("row", counted(len(row), "cell"), f"{len(heads)} as in the heads")
            cell = {name: (row[n].strip(), factor) for name, (n, factor) in columns.items()}
            rows.append((_step(cell, case), *_leakage(cell["leakage"][0])))
        except InputError as error:
            what = f"data, line {number}: {error.what}"
            faults.append(InputError(what, error.given, error.expected))
    if faults:
        raise InputErrors(faults)
    steps, leakage, sealed = zip(*rows, strict=True)
    values, below = np.array(leakage), np.array(sealed)
    if (count := len({step for step, _, low in rows if not low})) < 3:
        expected = "leakages at three loads or more, besides rows that are sealed"
        raise InputError("data", f"{counted(count, 'load')} with a leakage", expected)
    values[np.isnan(values)] = values[~below].min()
    return LeakTest(steps, values, below, unit)


def _columns(heads: list[str], case: Case) -> tuple[dict[str, tuple[int, float]], LeakUnit]:
    """Place of each known column, with the unit of loads in SI; and the unit of leakage."""
    found: dict[str, tuple[int, float]] = {}
    leakage_in: LeakUnit | None = None
    for n, head in enumerate(heads):
        match = _HEAD.fullmatch(head)
        name = _NAMES.get(match[1].lower()) if match else None
        if match is None or name is None:
            raise InputError("data: columns", shown(head), COLUMNS)
        if name in found:
            raise InputError("data: columns", f"{shortened(head)} twice", "each column once")
        unit, factor = match[2] or "", 1.0
        if name != "branch" and not unit:
            raise InputError("data: columns", f"{shown(head)} without a unit", COLUMNS)
        if name == "leakage":
            basis = leak_basis((case.output.test_fluid or case.fluid).fluid, 1.0)
            if lack := basis.lacks(leakage_in := leak_unit(unit)):
                raise InputError("data: columns", shown(head), lack)
        elif name != "branch":
            factor = to_si(f"1 {unit}", case.load.unit, f"data: column {match[1]}")
        found[name] = n, factor
    if "load" not in found or leakage_in is None:
        raise InputError("data: columns", ", ".join(heads), COLUMNS)
    return found, leakage_in


def _number(text: str, what: str, expected: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = np.nan
    if not (np.isfinite(value) and value >= 0):
        meant = f"; perhaps meant: {text.replace(',', '.')}" if _COMMA.fullmatch(text) else ""
        raise InputError(what, shown(text), expected + meant)
    return value


def _step(row: dict[str, tuple[str, float]], case: Case) -> LoadStep:
    """Load step of a row by its texts and their units in SI, in the unit of the loads of the case."""
    loads, unit = case.load, case.load.unit
    most = loads.highest
    least = min((*loads.loading, *loads.unloading))

    def within(key: str, what: str) -> float:
        text, factor = row[key]
        value = float(f"{_number(text, what, 'a number >= 0') * factor:.12g}")
        if not least * (1 - 1e-9) <= value <= most * (1 + 1e-9):
            range_ = f"a load of the case, from {to_text(least, unit)} to {to_text(most, unit)}"
            raise InputError(what, to_text(value, unit), range_)
        return value

    load, (branch, _) = within("load", "load"), row.get("branch", (BRANCHES[0], 1.0))
    if branch.lower() not in BRANCHES:
        raise InputError("branch", shown(branch), " or ".join(BRANCHES))
    if branch.lower() == BRANCHES[0]:
        return LoadStep(load)
    if "peak" in row and row["peak"][0]:
        peak = within("peak", "unloaded from")
    elif loads.peaks:
        peak = float(max(loads.peaks))
    else:
        expected = f"a column 'unloaded from [M{unit}]', as the case has no unload_from"
        raise InputError("unloaded from", "nothing", expected)
    if not load < peak:
        expected = f"a load below that from which it is unloaded, {to_text(peak, unit)}"
        raise InputError("load", to_text(load, unit), expected)
    return LoadStep(load, peak)


def _leakage(text: str) -> tuple[float, bool]:
    """Leakage or limit of a row (NaN without one), and whether it is sealed."""
    expected = f"a leakage >= 0, '{SEALED}', or a limit such as '{BELOW} 0.1'"
    if text.lower() == SEALED:
        return np.nan, True
    below = text.startswith(BELOW)
    value = _number(text.removeprefix(BELOW).strip(), "leakage", expected)
    if below and value == 0:
        raise InputError("leakage", shown(text), expected)
    return (value, below) if value else (np.nan, True)


#: What is calibrated, in the order of all arrays, with its unit.
UNITS = {"hardness": "Pa", "shortest_wave": "m", "factor": ""}
#: Probability of the regions that are given.
PROBABILITY = 0.9
#: Part of the mass of the posterior that is left out where the best cells are divided; slabs along ln(factor), and how
#: far they reach to either side of its mean, in deviations.
_LEFT, _SLABS, _FAR = 1e-4, 24, 4.5


@dataclass(frozen=True)
class Estimate:
    """A quantity in SI: its median, and the shortest interval that holds it with the probability `PROBABILITY`."""

    median: float
    lower: float
    upper: float

    @classmethod
    def of(cls, values: Array) -> Estimate:
        """From samples of a posterior."""
        ordered = np.sort(values)
        count = int(np.ceil(PROBABILITY * len(ordered)))
        n = np.argmin(np.log(ordered[count - 1 :] / ordered[: len(ordered) - count + 1]))
        return cls(float(np.median(ordered)), float(ordered[n]), float(ordered[n + count - 1]))


@dataclass(frozen=True, eq=False)
class Posterior:
    """Density of the three quantities in the unit cube: their logarithms between the ends of their ranges (3, 2).

    rows : load of the surrogate of each row of the test. error : relative, of the measured leakages.
    """

    test: LeakTest
    rows: list[int]
    ranges: Array
    surrogate: Surrogate
    error: float

    def quantities(self, cube: Array) -> Array:
        """The quantities in SI (n, 3) at points of the unit cube."""
        low, high = np.log(self.ranges).T
        return np.asarray(np.exp(low + cube * (high - low)))

    def curves(self, cube: Array) -> tuple[Array, Array, Array]:
        """ln(leakage) of the test by the model, its error by the surrogate, and whether it is open, (n, rows)."""
        mean, deviation, is_open = (part[:, self.rows] for part in self.surrogate.at(cube[:, :2]))
        return mean + np.log(self.quantities(cube)[:, 2:]), deviation, is_open

    def along_factor(self, plane: Array) -> tuple[Array, Array, Callable[[Array], Array]]:
        """At hardnesses and waves (n, 2): mean and deviation of ln(factor) by the rows that leak, each (n, 1), as it is
        normal; and a function that gives the ln of the density at ln(factors) (n, m).
        """
        mean, deviation, is_open = (part[:, self.rows] for part in self.surrogate.at(plane))
        low = self.test.sealed
        rest = np.log(self.test.leakage) - mean
        steps = np.array(self.rows)[~low]
        errors = deviation[:, ~low]
        correlation = self.surrogate.correlation[np.ix_(steps, steps)]
        covariance = correlation * errors[:, :, None] * errors[:, None]
        root = np.linalg.cholesky(covariance + self.error**2 * np.eye(len(steps)))
        both = np.linalg.solve(root, np.stack([rest[:, ~low], np.ones_like(errors)], axis=-1))
        white, one = both[..., 0], both[..., 1]
        width = (one**2).sum(1, keepdims=True) ** -0.5
        middle = (one * white).sum(1, keepdims=True) * width**2
        least = ((white - one * middle) ** 2).sum(1, keepdims=True)
        fixed = np.log(is_open[:, ~low]).sum(1) - np.log(np.diagonal(root, axis1=1, axis2=2)).sum(1)

        def density(factor: Array) -> Array:
            found = fixed[:, None] - 0.5 * (least + ((factor - middle) / width) ** 2)
            for row in np.flatnonzero(low):
                wide = np.hypot(deviation[:, row, None], self.error)
                above = ndtr((factor - rest[:, row, None]) / wide)
                found += np.log(1 - is_open[:, row, None] * above)
            return found

        return middle, width, density

    def samples(self, count: int) -> Array:
        """Samples of the posterior in the unit cube (count, 3), evenly drawn; `count` is a power of 2.

        The cube is divided into four cells a sample along hardness and wave, of which the quarter with the most mass is
        divided further as long as it holds nearly all, and into slabs along the factor. A Sobol sequence draws from
        them: last digits of the density move few samples, and to the next cell, unlike the states of a Markov chain.
        """
        low, high = np.log(self.ranges[2])
        side = round(2 * count**0.5)
        plane = (np.indices((side, side)).reshape(2, -1).T + 0.5) / side
        while True:
            middle, width, density = self.along_factor(plane)
            inside = np.clip(middle, low, high)
            first, last = (np.clip(inside + far * width, low, high) for far in (-_FAR, _FAR))
            middles = first + (last - first) * (np.arange(_SLABS) + 0.5) / _SLABS
            weight = density(middles) + np.log(last - first)
            weight = np.exp(weight - weight.max())
            mass = weight.sum(1)
            best = np.sort(np.argsort(-mass, kind="stable")[: len(mass) // 4])
            if not mass[best].sum() >= (1 - _LEFT) * mass.sum():
                break
            side *= 2
            quarters = np.array([[-1, -1], [-1, 1], [1, -1], [1, 1]]) / (2 * side)
            plane = (plane[best, None] + quarters).reshape(-1, 2)
        drawn = qmc.Sobol(4, rng=np.random.default_rng(1)).random_base2(count.bit_length() - 1)
        ends = np.cumsum(weight) / weight.sum()
        cell, slab = np.divmod(np.searchsorted(ends[:-1], drawn[:, 0]), _SLABS)
        factor = first[cell, 0] + (last - first)[cell, 0] * (slab + drawn[:, 3]) / _SLABS
        return np.c_[plane[cell] + (drawn[:, 1:3] - 0.5) / side, (factor - low) / (high - low)]
