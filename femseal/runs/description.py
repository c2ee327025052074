"""What a run computes, in lines for `femseal check` and for the report: face, loads, solids, fluid, studies, seal."""

from collections.abc import Iterator
from math import prod

import numpy as np

from ..base import Shape, counted, to_text
from ..case.case import Case
from ..case.case_tables import SolidTable
from ..case.faces import FileFace
from ..materials import METALS
from ..preparation.preparation import Prepared
from ..results.results import cycle_text
from ..results.variables import fluid_text
from ..studies import Scene
from ..studies.blocks import blocks_of
from ..studies.sampling import describe_map
from ..studies.study_registry import LADDER_STATES, on_ladder
from ..topography import Places

#: Shortest waves that a piece should hold along each side.
ADVISED_WAVES = 8


def described(case: Case, prepared: Prepared) -> Iterator[tuple[str, str]]:
    """Name and text of each line on a prepared case; one that goes on with the name before has none."""
    scene = prepared.scene
    files = (
        ", ".join(str(place.path) for place in face.places or [face])
        if isinstance(face, FileFace)
        else face.kind
        for face in case.face
    )
    yield "face", " against ".join(files)
    yield from _surface_facts(prepared)
    if prepared.seat:
        yield "seat", prepared.seat
    yield "load", _load_text(case, scene)
    yield "material", solids_text(case)
    yield "", f"contact modulus {to_text(scene.modulus, 'Pa')}, {scene.law}"
    for table, what in ((case.fluid, ""), (case.output.test_fluid, "test fluid: ")):
        if table is not None:
            inlet, outlet = (
                to_text(table.inlet_pressure, "Pa"),
                to_text(table.outlet_pressure, "Pa"),
            )
            text, name = fluid_text(table.fluid), table.name or ""
            text = text if name in text else f"{name}: {text}"
            yield "fluid", f"{what}{text}, from {inlet} to {outlet}"
        if table is case.fluid:
            yield "", scene.fluid_effect
    yield "flow", f"solver {scene.solver}"
    yield from _law_facts(scene)
    yield from _study_facts(prepared)
    if str(scene.layout) != "a strip":
        yield "seal", str(scene.layout)
    if (first := prepared.first_answer) is not None:
        yield "first answer", str(first)


def solids_text(case: Case) -> str:
    """The two solids of a case, and which of them yields."""
    face, counter = case.material, case.counter_material
    if counter is None:
        return f"{_solid_text(face)} against a rigid flat"
    text = f"{_solid_text(face)} against {_solid_text(counter)}"
    hardness = {"face": face.law.mean_hardness, "counter-face": counter.law.mean_hardness}
    softer, _ = sorted(hardness, key=hardness.__getitem__)
    low, high = sorted(hardness.values())
    if low == np.inf:
        return text
    other = to_text(high, "Pa") if high < np.inf else "no pressure"
    text += f"; the {softer} yields, at {to_text(low, 'Pa')}, and the other at {other}"
    return text


def _solid_text(solid: SolidTable) -> str:
    """A solid, with the source of the values that its name stands for."""
    text = f"E = {to_text(solid.young, 'Pa')}, ν = {solid.poisson:g}"
    for value, name in ((solid.hardness, "hardness"), (solid.yield_stress, "yield stress")):
        text += "" if value is None else f", {name} {to_text(value, 'Pa')}"
    text += ", hardness by a table of depths" if solid.hardness_table else ""
    for name, (_, source) in METALS.items():
        if name.casefold() == (solid.name or "").casefold().strip():
            return f"{name} ({source}; keys of the case come first): {text}"
    return text


def _load_text(case: Case, scene: Scene) -> str:
    """The steps of the cycle, and its highest load."""
    text = f"{cycle_text(scene.steps)}, up to {to_text(scene.steps.pressures.max(), 'Pa', 3)}"
    if case.load.unit != "Pa":
        text += f", from {to_text(case.load.highest, case.load.unit)}"
    return text


def _surface_facts(prepared: Prepared) -> Iterator[tuple[str, str]]:
    """Points, roughness and filter of the face."""
    scene, report = prepared.scene, prepared.conditioning
    surface = scene.surface
    size, pixel = (
        " × ".join(to_text(x, "m", 4) for x in pair) for pair in (surface.size, surface.spacing)
    )
    yield "surface", f"{surface.shape[0]} × {surface.shape[1]} points, {size}, pixel {pixel}"
    height, slope = to_text(surface.rms_height, "m", 3), surface.rms_slope
    hard = ": a flat face" if not slope else ""
    if slope and np.isfinite(scene.law.mean_hardness):  # of elastic faces it is not
        hard = f", H/(E*·slope) {scene.law.mean_hardness / scene.modulus / slope:.3g}"
    yield "", f"rms height {height}, rms slope {slope:.3g}{hard}"
    if report.undefined_fraction or report.spike_points:
        undefined = f"{report.undefined_fraction:.2%} undefined points"
        yield "", f"{undefined} and {report.spike_points} in spikes filled"
    if isinstance(surface, Places):
        yield "", f"{len(surface.widths)} places"
    if overlap := prepared.overlap:
        size = " × ".join(to_text(length, "m", 3) for length in overlap.size)
        resampled = ", the second resampled" if overlap.resampled else ""
        yield "", f"two faces overlap on {size}, {overlap.fraction:.0%} of the first{resampled}"
    known = [one for one in (prepared.holds, prepared.form_effect) if one and not one.doubts]
    for text in (*map(str, known), str(prepared.continuation or ""), report.unseen):
        if text:
            yield "", text
    shortest = report.shortest_wave
    kept = f"waves below {to_text(shortest, 'm', 3)} ({shortest / max(surface.spacing):.3g} pixels) removed"
    removed = 1 - surface.rms_slope / report.rms_slope_before if report.rms_slope_before else 0.0
    yield "filter", f"{kept}, with {removed:.0%} of the rms slope"


def _law_facts(scene: Scene) -> Iterator[tuple[str, str]]:
    """What the law of the fluid does to the flow in a gap of the rms height, where it is not the cubic one."""
    drop = scene.flow.drop
    if drop.law.homogeneous:
        return
    ends = [max(p, drop.least_pressure) for p in (drop.inlet, drop.outlet)]
    at_inlet, at_outlet = drop.law.factor(scene.surface.rms_height, ends)
    what = "times the viscous flow in a gap of the rms height"
    yield "slip", f"{at_inlet:.3g} (inlet) to {at_outlet:.3g} (outlet) {what}"


def _study_facts(prepared: Prepared) -> Iterator[tuple[str, str]]:
    """What every study solves."""
    scene, steps = prepared.scene, len(prepared.scene.steps)
    pixels = prod(scene.surface.shape)
    of_face = f"{steps} contact and {counted(steps, 'flow solution')} of {pixels} unknowns"
    if "deterministic" in prepared.methods:
        yield "deterministic", of_face
    if prepared.cells is None:
        return
    m1, m2 = prepared.cells
    yield "pieces", _pieces(prepared, prepared.cells)
    if "two-scale" in prepared.methods:
        yield "two-scale", f"{of_face}, {counted(2 * steps * m1 * m2, 'flow solution')} of pieces"
    if "blocks" in prepared.methods:
        b1, b2 = blocks_of(prepared.cells)
        points = f"{scene.surface.shape[0] // b1} × {scene.surface.shape[1] // b2} points"
        yield "blocks", f"{b1} × {b2} blocks of {points}, about {LADDER_STATES:.0f} states of each"
    if (sampling := prepared.sampling) is None or "stochastic" not in prepared.methods:
        return
    _, tiles = prepared.cut_and_tiles
    length = to_text(tiles.size[1], "m", 3)
    number, how = "seals", ", as many as the band of error needs"
    if sampling.realisations is not None:
        number, how = counted(sampling.realisations, "seal"), ""
    states, where = counted(steps, "state"), "at its loads"
    if tiles.in_place:
        where = "at its loads; pieces stay in their rows"
    elif on_ladder(scene, sampling):
        states, where = f"about {LADDER_STATES:.0f} states", "on a ladder of nominal pressures"
    yield "stochastic", f"{states} of the face, {where}"
    drawn = f"{length} long"
    if tiles.part < 1:
        drawn = f"{100 * tiles.part:.2g} % of a length of {length}"
    yield "", f"{number} of {tiles}, {drawn}{how}"
    if uneven := describe_map(scene, tiles, sampling.pressure_map):
        yield "pressure map", uneven


def _pieces(prepared: Prepared, count: Shape) -> str:
    """Number and size of pieces."""
    sizes = [side / m for side, m in zip(prepared.scene.surface.size, count, strict=True)]
    waves = [length / prepared.conditioning.shortest_wave for length in sizes]
    size = " × ".join(to_text(length, "m", 3) for length in sizes)
    text = f"{count[0]} × {count[1]} of about {size}, that is {waves[0]:.3g} × {waves[1]:.3g} shortest waves"
    if min(waves) < ADVISED_WAVES * 0.99:
        text += f"; {ADVISED_WAVES} or more are advised, of a larger face"
    return text
