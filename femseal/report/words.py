"""Texts and numbers of the report: the case, its origin, the errors, the time."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..base.files import read_plain
from ..base.quantities import to_text
from ..results.attempts_table import as_chosen
from ..results.summary import solvers_text
from ..results.tables import format_error_band, format_leakage, in_several_units
from ..studies.curve_distance import FLOOR, leakage_factor
from .case_text import contact_text, fluid_text, solids_text
from .load_words import load_sentences

if TYPE_CHECKING:
    import xarray

    from ..results.results import Results

Array = NDArray[np.float64]
Lines = list[tuple[str, ...]]


@dataclass(frozen=True)
class KeyNumber:
    """One of the numbers at the head of the report."""

    label: str
    value: str
    note: str


def key_numbers(results: Results) -> list[KeyNumber]:
    """Leakage at the first and the highest load and after the last unloading; contact there."""
    data, steps, leakage = results.dataset, results.steps, results.leakage.values
    unit, factor = results.leak_scale
    peak = max(range(len(steps)), key=lambda s: steps[s].pressure)
    numbers, budget = [], results.budget
    for s in dict.fromkeys((0, peak, len(steps) - 1)):
        value = format_leakage(leakage[s], factor)
        value += f" {unit.name}" if leakage[s] and not np.isnan(leakage[s]) else ""
        note = ""
        if budget is not None:
            note = f"95 % band of error {format_error_band(budget.lower[s], budget.upper[s], factor)}"
        elif "leakage_lower" in data:
            ends = (format_leakage(float(data[f"leakage_{end}"][s]), factor) for end in ("lower", "upper"))
            note = f"band of the realisations {'–'.join(ends)}"
        numbers.append(KeyNumber(steps[s].name, value, note))
    if "contact_fraction" in data:
        share = float(data["contact_fraction"][peak])
        numbers.append(KeyNumber("in contact at the highest load", f"{100 * share:.3g} %", ""))
    return numbers


def case_sentences(results: Results) -> list[str]:
    """The case in words; sentences without data in the results are left out."""
    data, case = results.dataset, results.case
    attrs = data.attrs
    width, length = (float(v) for v in attrs["seal_size_m"])
    sides = f"{to_text(width, 'm')} wide along the leakage and {to_text(length, 'm')} long"
    shape = str(attrs.get("seal", "a strip"))
    sentences = [f"A seal {sides}." if shape == "a strip" else f"The seal is {shape}; it is about {sides}."]
    faces = [_face_text(face) for face in case.get("face", [])]
    if faces:
        surface = json.loads(attrs["surface"])
        grid = f", solved on {' × '.join(map(str, surface['shape']))} points" if "shape" in surface else ""
        text = " against ".join(faces)
        sentences.append(f"{text[0].upper()}{text[1:]}{grid}.")
    if surface_text := _surface_text(json.loads(attrs["surface"])):
        sentences.append(surface_text)
    sentences += [f"The solids: {solids_text(case)}."] if "young" in case.get("material", {}) else []
    text = contact_text(float(attrs["contact_modulus_Pa"]), str(attrs["contact_law"]))
    sentences.append(f"{text[0].upper()}{text[1:]}.")
    sentences += load_sentences(data, case)
    inlet, outlet = (to_text(float(attrs[f"{end}_pressure_Pa"]), "Pa") for end in ("inlet", "outlet"))
    sentences.append(
        f"The fluid, {fluid_text(case.get('fluid', {}), str(attrs['fluid']))}, runs from {inlet} to {outlet}."
    )
    sentences += _method_sentences(results)
    return sentences


def _face_text(face: dict[str, Any]) -> str:
    kind = str(face.get("kind", "face"))
    if kind == "file":
        return f"a measured face from {face.get('path', 'a file')}{_placement_text(face)}"
    known = (("pitch", "m"), ("depth", "m"), ("roughness", "m"), ("hurst", ""), ("rms_slope", ""), ("rms_height", "m"),
             ("roll_off", "m"))  # fmt: skip
    facts = [
        f"{name.replace('_', ' ').replace('hurst', 'Hurst exponent')} {_with_unit(face[name], unit)}"
        for name, unit in known
        if face.get(name)
    ]
    return f"a {kind} face" + (f" ({', '.join(facts)})" if facts else "")


def _placement_text(face: dict[str, Any]) -> str:
    """Placement of the second face on the first, in the order of its operations."""
    facts = []
    if "mirror" in face:
        facts.append(f"mirrored along {face['mirror']}")
    if "rotate" in face:
        facts.append(f"turned by {np.degrees(face['rotate']):.3g}°")
    if "shift" in face:
        facts.append(f"shifted by {', '.join(to_text(length, 'm', 3) for length in face['shift'])}")
    return f" ({', '.join(facts)})" if facts else ""


def _with_unit(value: float, unit: str) -> str:
    return to_text(value, unit, 3) if unit else f"{value:g}"


def _surface_text(surface: dict[str, Any]) -> str:
    if "rms_slope" not in surface or "rms_height" not in surface:
        return ""
    text = f"Its rms height is {to_text(surface['rms_height'], 'm', 3)}, its rms slope {surface['rms_slope']:.3g}"
    share, spikes = surface.get("undefined_share"), surface.get("spikes")
    filled = [f"{100 * share:.2g} % undefined points"] if share else []
    filled += [f"{spikes} {'point' if spikes == 1 else 'points'} in spikes"] if spikes else []
    if filled:
        text += f"; {' and '.join(filled)} were filled"
    return text + "."


def _method_sentences(results: Results) -> list[str]:
    data, case = results.dataset, results.case
    sentences = []
    if "leakage_deterministic" in data:
        sentences.append("Deterministic: contact and flow of the whole face at full resolution.")
    if "window_pressure" in data:
        windows = f"{data.sizes['cell1']} × {data.sizes['cell2']} windows"
        flow = (
            "as finite elements with nodes on their sides"
            if "element_error" in data
            else "with the flow resolved at every pixel"
            if "k1" not in data
            else "between the nodes of a global flow"
        )
        sentences.append(f"Two scales: {windows} {_contact_text(data)}, {flow}.")
    if "leakage_median" in data:
        drawn = {name: data.attrs[name] for name in ("sampler",) if name in data.attrs} | case.get("stochastic", {})
        how = [f"{name} {drawn[name]}" for name in ("sampler", "pressure") if name in drawn]
        size = int(data.attrs.get("library_windows", data.sizes["library_cell"]))
        independent = int(data.attrs.get("library_independent", size))
        sentences.append(
            f"Stochastic: {data.sizes['realisation']} seals drawn from {size} library windows"
            + (f", {independent} of them without overlap" if independent < size else "")
            + (f", {_contact_text(data)}" if "window_contact" in data.attrs and "window_pressure" not in data else "")
            + (f" ({', '.join(how)})" if how else "")
            + (f", seed {data.attrs['seed']}" if "seed" in data.attrs else "")
            + ". The leakage given is their median."
        )
        if "seal_length" in data.coords:
            lengths = ", ".join(to_text(float(x), "m") for x in data["seal_length"].values[1:])
            sentences.append(f"Seals of other lengths are drawn from the same library: {lengths}.")
    return sentences


def _contact_text(data: xarray.Dataset) -> str:
    by_windows = data.attrs.get("window_contact") == "windows"
    return "whose contact is solved in each of them" if by_windows else "cut from the contact of the whole face"


def origin_lines(results: Results) -> list[tuple[str, str]]:
    """When and by what the results were computed, and the digest of every measured face: label, text."""
    attrs = results.dataset.attrs
    date = str(attrs.get("date_created", ""))
    lines = [("computed", date.replace("T", " ").replace("+00:00", " UTC"))] if date else []
    try:
        faces = json.loads(attrs.get("face_files", "{}"))
        lines += [(f"SHA-256 of {name}", str(digest)) for name, digest in faces.items()]
    except (TypeError, ValueError, AttributeError):
        return lines
    return lines


def scatter_lines(results: Results) -> Lines:
    """Scatter and differences as factors: source, typical value, largest value, its step, meaning."""
    data, steps = results.dataset, results.steps
    leaking = np.abs(results.leakage.values) > FLOOR * np.abs(results.leakage.values[0])
    lines: Lines = []

    def deviation(source: str, sigma: Array, meaning: str) -> None:
        chosen = np.where(leaking, sigma, np.nan)
        if np.isfinite(chosen).any():
            worst = int(np.nanargmax(chosen))
            typical, largest = (_factor(float(np.exp(v))) for v in (np.nanmedian(chosen), chosen[worst]))
            lines.append((source, typical, largest, steps[worst].name, meaning))

    if "realisation_spread" in data:
        spread = data["realisation_spread"].values
        deviation("realisations", spread, "one standard deviation between drawn seals")
        if "library_error" in data:
            error = data["library_error"].values
            deviation("finite library", error, "one standard deviation between libraries of this size")
            deviation("both together", np.hypot(spread, error), "what a seal of this kind may differ from the median")
        share = 1.2533 / np.sqrt(data.sizes["realisation"])
        deviation("median", share * spread, "standard error of the median; more realisations lower it")
    if "element_error" in data:
        meaning = "at most, estimated from the last iterations; the leakage through elements is an upper bound"
        deviation("flow through elements", np.log1p(data["element_error"].values), meaning)
    if "cut_error" in data:
        meaning = "half the way from Neumann to Dirichlet cuts; a longer face lowers it"
        deviation("cuts between runs", data["cut_error"].values, meaning)
    if "leakage_lower_bound" in data:
        low, high = (np.median(data[f"leakage_{end}_bound"].values, axis=0) for end in ("lower", "upper"))
        half = 0.5 * np.log(np.divide(high, low, out=np.full(low.shape, np.nan), where=low != 0))
        deviation("pixels", half, "half the way between the bounds of the flow through pixels; finer ones lower it")
    pairs = (
        ("two-scale", "leakage_two_scale", "deterministic", "leakage_deterministic"),
        ("median", "leakage_median", "two-scale", "leakage_two_scale"),
        ("median", "leakage_median", "deterministic", "leakage_deterministic"),
    )
    for one, name, other, reference in pairs:
        if name in data and reference in data:
            lines += _comparison(results, one, data[name].values, other, data[reference].values)
    if "leakage_filtered" in data:
        lines += _comparison(
            results, "twice the shortest wave", data["leakage_filtered"].values, results.method, results.leakage.values
        )
    return lines


def _comparison(results: Results, one: str, leakage: Array, other: str, reference: Array) -> Lines:
    lines: Lines = []
    steps = results.steps
    for branch in dict.fromkeys(s.branch for s in steps):
        factor = leakage_factor(leakage, reference, steps, branch)
        if not factor.loads:
            continue
        chosen = np.array([s.branch == branch for s in steps]) & (np.abs(reference) > FLOOR * np.abs(reference[0]))
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = np.where(chosen & (leakage * reference > 0), np.abs(np.log(leakage / reference)), np.nan)
        worst = int(np.nanargmax(ratio))
        meaning = f"rms over {factor.loads} loads" + (
            f", {factor.closed} more closed in one only" if factor.closed else ""
        )
        source = f"{one} against {other}, {branch}"
        lines.append((source, _factor(factor.value), _factor(float(np.exp(ratio[worst]))), steps[worst].name, meaning))
    return lines


def check_lines(results: Results) -> Lines:
    """Residuals and resolution: quantity, value, meaning."""
    data, case = results.dataset, as_chosen(results.case, results.attempts)
    lines: Lines = []
    if (rtol := case.get("contact", {}).get("rtol")) is not None:
        lines.append(("contact residual", f"≤ {rtol:.0e}", "reached by every contact that is not among the failures"))
    if "window_pressure" in data:
        nominal = data["nominal_pressure"].values
        carried = data["window_pressure"].values.mean(axis=(1, 2))
        off = np.abs(carried - nominal)[nominal > 0] / nominal[nominal > 0]
        if off.size:
            lines.append(("load of the windows", f"{np.nanmax(off):.0e}", "largest distance from the nominal pressure"))
        if data.attrs.get("window_contact") == "windows":
            meaning = "rms distance of the stitched gap from that of its pressure on the whole half-space"
            lines.append(("gap of the windows", f"{np.nanmax(data['gap_error'].values):.1%}", meaning))
    if "flux1" in data:
        rows, whole = data["flux1"].values.mean(axis=2), data["leakage_two_scale"].values
        open_ = np.nan_to_num(whole) != 0
        if open_.any():
            balance = np.abs(rows[open_] / whole[open_, None] - 1)
            lines.append(
                ("flow balance", f"{np.nanmax(balance):.0e}", "largest difference of a row's flow from the leakage")
            )
    for study, counts in json.loads(data.attrs["counts"]).items():
        if counts:
            text = ", ".join(f"{n} {kind}" for kind, n in counts.items())
            lines.append(
                (
                    f"flows of windows, {study.replace('_', '-')}",
                    text,
                    "closed ones are exactly 0, open ones follow h̄³/12, equal ones were solved at an earlier step",
                )
            )
    for study, solvers in json.loads(data.attrs.get("solvers", "{}")).items():
        meaning = "which solver solved how many; the imbalance is that of inlet and outlet flow"
        lines.append((f"linear systems, {study.replace('_', '-')}", solvers_text(solvers), meaning))
    for study, number in json.loads(data.attrs.get("equal_steps", "{}")).items():
        text = f"{number} of {data.sizes['step']}"
        meaning = "the same state as an earlier step bit for bit, which is solved once"
        lines.append((f"equal load steps, {study.replace('_', '-')}", text, meaning))
    surface = json.loads(data.attrs["surface"])
    if "shortest_wavelength" in surface and "spacing" in surface:
        wave, pixel = surface["shortest_wavelength"], max(surface["spacing"])
        lines.append(
            (
                "resolution",
                f"{wave / pixel:.3g} pixels",
                f"of {to_text(pixel, 'm', 3)} to the shortest wave, {to_text(wave, 'm', 3)}",
            )
        )
        if before := surface.get("rms_slope_before"):
            lost = 1 - surface["rms_slope"] / before
            meaning = "of the rms slope, with the waves shorter than that"
            if measured := surface.get("rms_slope_measured"):
                kept = min(1.0, surface["rms_slope"] / measured)
                end = to_text(surface["shortest_measured"], "m", 3)
                meaning += f"; {1 - kept:.1%} of that of waves above noise, which end at {end}"
            lines.append(("slope removed", f"{100 * lost:.2g} %", meaning))
    return lines


def accuracy_lines(results: Results) -> Lines:
    """Factors that `femseal accuracy` wrote into the folder of the results for the same case; none if it did not."""
    if results.folder is None:
        return []
    try:
        found = json.loads(read_plain(results.folder / "accuracy.json", 1e7))
        if found["case"] != results.case:
            return []
        return [
            (
                f"{s['method']}, {' × '.join(map(str, s['points']))} points"
                + (f", {' × '.join(map(str, s['cells']))} windows" if s["cells"] else ""),
                c["against"],
                *(_factor(c[branch]["factor"]) for branch in ("loading", "unloading")),
                _factor(s["budget"]["factor"] if s.get("budget") else None),
                f"{s['seconds']:.3g} s" + (", recommended" if s.get("recommended") else ""),
            )
            for s in found["solutions"]
            for c in s["comparisons"]
        ]
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return []


def _factor(value: float | None) -> str:
    return "–" if value is None or np.isnan(value) else f"× {value:.3g}"


def time_lines(results: Results) -> list[tuple[str, str, float]]:
    """Stage, time, and its share of the whole in percent; the parts of a study come before the rest of its time."""
    timings: dict[str, float] = json.loads(results.dataset.attrs["timings"])
    whole = sum(seconds for name, seconds in timings.items() if ": " not in name) or 1.0
    lines = []
    for name, seconds in timings.items():
        parts = [part for other, part in timings.items() if other.startswith(f"{name}: ")]
        label = f"{name}: rest" if parts else name
        own = max(seconds - sum(parts), 0.0)
        lines.append((label, f"{own:.3g} s", 100 * own / whole))
    return lines


def total_leakage_text(results: Results) -> str:
    """Leakage of the whole seal at the highest load, in several units."""
    steps = results.steps
    peak = max(range(len(steps)), key=lambda s: steps[s].pressure)
    if not (whole := in_several_units(results, peak)):
        return ""
    length, load = to_text(results.leak_basis.length, "m"), to_text(steps[peak].pressure, "Pa")
    return f"Over its whole length of {length} the seal leaks {whole} at {load}.{_reference_text(results)}"


def _reference_text(results: Results) -> str:
    basis = results.leak_basis
    if basis.pressure is None or basis.temperature is None:
        return ""
    state = f"{basis.pressure:g} Pa and {basis.temperature:g} K"
    return (
        f" Volumes of the gas are those at {state}, standard ones at 0 °C; its pressure × volume is that at "
        f"{basis.stated_temperature:g} K."
    )


def flat(value: Any, name: str = "") -> list[tuple[str, str]]:
    """A nested case as lines of key and value."""
    if isinstance(value, dict):
        return [line for key, item in value.items() for line in flat(item, f"{name}.{key}" if name else str(key))]
    if isinstance(value, list) and any(isinstance(item, dict) for item in value):
        return [
            line for n, item in enumerate(value, 1) for line in flat(item, name if len(value) == 1 else f"{name} {n}")
        ]
    if isinstance(value, list):
        return [(name, ", ".join(_plain(item) for item in value))]
    return [(name, _plain(value))]


def _plain(value: Any) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)
