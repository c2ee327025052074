"""Describe a case and the input of its studies in lines of text, for `femseal check` and for the report."""

from collections.abc import Iterator

import numpy as np

from ..base import Shape, as_text, to_text
from ..budget.study_input import StudyInput
from ..case.case import Case
from ..case.faces import Face, FileFace
from ..case.seal_tables import FluidTable
from ..case.solid_table import CoatingTable, SolidTable
from ..checks import FormEffect, QuickEstimate, mean_modulus
from ..materials import METALS
from ..preparation.drawing_check import drawing_text
from ..results.load_steps import cycle_text
from ..results.variables import fluid_text
from ..seal.layouts import RectangularLayout
from ..studies import Scene
from ..topography import Patches

#: Smallest recommended length of a side of a cell, as a multiple of the shortest wavelength.
ADVISED_WAVES = 8

#: Name and text of a line. A line with the name "" continues the last named line before it.
Line = tuple[str, str]


def describe_case(
    case: Case,
    study_input: StudyInput,
    estimate: QuickEstimate | None,
    form_effect: FormEffect | None,
) -> Iterator[Line]:
    """Describe surface, loads, materials, fluids and studies of a case in lines of text.

    Parameters
    ----------
    case : Case
        The case.
    study_input : StudyInput
        The input of the studies.
    estimate : QuickEstimate or None
        Quick estimate of the leakage; None if a quick estimate is not possible for the case.
    form_effect : FormEffect or None
        Effect of the form deviation of a measured patch on the leakage; None if the effect is not computed.

    Yields
    ------
    name, text : str
        Name and text of a line. A line with the name "" continues the last named line before it.
    """
    scene = study_input.scene
    yield "face", " against ".join(_face_text(face) for face in case.face)
    yield from _surface_lines(study_input, form_effect)
    roughness = drawing_text(case, scene.surface)
    if roughness:
        yield "roughness", roughness
    if study_input.seat:
        yield "seat", study_input.seat
    yield "load", _load_text(case, scene)
    yield "material", solids_text(case)
    of_waves = " of short waves" if scene.coatings else ""
    modulus = to_text(scene.surface_modulus, "Pa")
    yield "", f"contact modulus{of_waves} {modulus}, {scene.law}"
    yield "fluid", _fluid_text(case.fluid)
    yield "", scene.fluid_effect
    if case.output.test_fluid is not None:
        yield "fluid", f"test fluid: {_fluid_text(case.output.test_fluid)}"
    yield "flow", f"solver {scene.solver}"
    yield from _slip_lines(scene)
    yield from _study_lines(study_input)
    if scene.layout != RectangularLayout():
        yield "seal", str(scene.layout)
    if estimate is not None:
        yield "quick estimate", str(estimate)


def _face_text(face: Face) -> str:
    """Return the file names of a measured face, or the kind of a generated face."""
    if not isinstance(face, FileFace):
        return face.kind
    return ", ".join(str(patch.path) for patch in face.patches or [face])


def _fluid_text(table: FluidTable) -> str:
    """Describe a fluid, and its pressures at inlet and outlet.

    The description begins with the name of the fluid, unless it already contains this name.
    """
    text = fluid_text(table.fluid)
    name = table.name or ""
    if name not in text:
        text = f"{name}: {text}"
    inlet = to_text(table.inlet_pressure, "Pa")
    outlet = to_text(table.outlet_pressure, "Pa")
    return f"{text}, from {inlet} to {outlet}"


def solids_text(case: Case) -> str:
    """Describe the two solids of a case, and say which of them yields."""
    face, counter = case.material, case.counter_material
    if counter is None:
        return f"{_solid_text(face)} against a rigid flat"
    text = f"{_solid_text(face)} against {_solid_text(counter)}"
    face_hardness = face.law.mean_hardness
    counter_hardness = counter.law.mean_hardness
    softer = "counter-face" if counter_hardness < face_hardness else "face"
    low = min(face_hardness, counter_hardness)
    high = max(face_hardness, counter_hardness)
    if low == np.inf:  # neither of them yields
        return text
    low_text = to_text(low, "Pa")
    other = (
        f"the other yields at {to_text(high, 'Pa')}" if high < np.inf else "the other is elastic"
    )
    return f"{text}; the {softer} is the softer one and yields at {low_text}, {other}"


def _solid_text(solid: SolidTable) -> str:
    """Describe a solid: elastic constants, hardness, coating, and the source of the data if a known metal is named."""
    text = f"E = {to_text(solid.young, 'Pa')}, ν = {solid.poisson:g}"
    text += _strength_text(solid)
    if solid.hardness_table:
        text += ", hardness by a table of depths"
    text = _with_metal(solid, text)
    if solid.coating is None:
        return text
    thickness = to_text(solid.coating.thickness, "m")
    return f"a coating of {thickness}, {_coating_text(solid.coating)}, on {text}"


def _coating_text(coating: CoatingTable) -> str:
    """Describe a coating: elastic constants, hardness, and the source of the data if a known metal is named."""
    text = f"E = {to_text(coating.young, 'Pa')}, ν = {coating.poisson:g}"
    return _with_metal(coating, text + _strength_text(coating))


def _strength_text(solid: SolidTable | CoatingTable) -> str:
    """Return the hardness and yield stress of a solid or coating as text, each preceded by a comma."""
    text = ""
    for name, value in (("hardness", solid.hardness), ("yield stress", solid.yield_stress)):
        if value is not None:
            text += f", {name} {to_text(value, 'Pa')}"
    return text


def _with_metal(solid: SolidTable | CoatingTable, properties: str) -> str:
    """Prefix the description of a solid with the name of a known metal and the source of its data."""
    solid_name = (solid.name or "").casefold().strip()
    for name, (_, source) in METALS.items():
        if name.casefold() == solid_name:
            return f"{name} ({source}; keys of the case come first): {properties}"
    return properties


def _load_text(case: Case, scene: Scene) -> str:
    """Describe the steps of the load cycle, and its highest load."""
    text = f"{cycle_text(scene.steps)}, up to {to_text(scene.steps.pressures.max(), 'Pa', 3)}"
    if case.load.unit != "Pa":
        text += f", from {to_text(case.load.highest, case.load.unit)}"
    return text


def _surface_lines(study_input: StudyInput, form_effect: FormEffect | None) -> Iterator[Line]:
    """Describe the points of the surface, its roughness, how it was measured, and its filter."""
    surface = study_input.scene.surface
    conditioning = study_input.conditioning
    points = f"{as_text(surface.shape)} points, {as_text(surface.size, 'm')}"
    yield "surface", f"{points}, pixel {as_text(surface.spacing, 'm')}"
    yield "", _roughness_text(study_input.scene)
    if conditioning.undefined_fraction or conditioning.spike_points:
        undefined = f"{conditioning.undefined_fraction:.2%} undefined points"
        yield "", f"{undefined} and {conditioning.spike_points} in spikes filled"
    if isinstance(surface, Patches):
        yield "", f"{len(surface.widths)} patches"
    overlap = study_input.overlap
    if overlap:
        size = " × ".join(to_text(length, "m", 3) for length in overlap.size)
        resampled = ", the second resampled" if overlap.resampled else ""
        yield "", f"two faces overlap on {size}, {overlap.fraction:.0%} of the first{resampled}"
    # longest waves and form are left out where warnings describe them
    waves = study_input.longest_waves
    if waves is not None and not waves.warnings:
        yield from _line_unless_empty(str(waves))
    if form_effect is not None and not form_effect.warnings:
        yield from _line_unless_empty(str(form_effect))
    yield from _line_unless_empty(str(study_input.continuation or ""))
    yield from _line_unless_empty(conditioning.unseen)
    yield "filter", _filter_text(study_input)


def _line_unless_empty(text: str) -> Iterator[Line]:
    """Yield the text as a line without a name, or nothing if it is empty."""
    if text:
        yield "", text


def _roughness_text(scene: Scene) -> str:
    """Return rms height and rms slope of the surface as text and, for a plastic contact, the ratio H/(E*·slope)."""
    surface, hardness = scene.surface, scene.law.mean_hardness
    slope = surface.rms_slope
    text = f"rms height {to_text(surface.rms_height, 'm', 3)}, rms slope {slope:.3g}"
    if not slope:
        return f"{text}: a flat face"
    if np.isfinite(hardness):
        text += f", H/(E*·slope) {hardness / mean_modulus(scene) / slope:.3g}"
    return text


def _filter_text(study_input: StudyInput) -> str:
    """Say which waves the low-pass filter has removed, and by how much this has reduced the rms slope."""
    surface = study_input.scene.surface
    shortest = study_input.conditioning.shortest_wave
    slope_before = study_input.conditioning.rms_slope_before
    n_pixels = shortest / max(surface.spacing)
    waves = f"waves below {to_text(shortest, 'm', 3)} ({n_pixels:.3g} pixels) removed"
    removed = 1 - surface.rms_slope / slope_before if slope_before else 0.0
    removed = max(0.0, removed)  # rounding can make it slightly negative
    return f"{waves}, with {removed:.0%} of the rms slope"


def _slip_lines(scene: Scene) -> Iterator[Line]:
    """If the fluid slips, say by how much slip increases the flow through a gap equal to the rms height."""
    drop = scene.flow.drop
    if drop.law.homogeneous:  # the cubic law
        return
    height = scene.surface.rms_height
    factor = drop.mean_factor_of(height)
    gap = f"a gap of the rms height, {to_text(height, 'm', 3)}"
    yield "slip", f"{factor:.3g} times the viscous flow in {gap}"


def _study_lines(study_input: StudyInput) -> Iterator[Line]:
    """Say how many contact and flow problems each study solves, and how large the cells of the surface are."""
    cells = study_input.cells
    without_cells = [study for study in study_input.studies if not study.needs_cells]
    with_cells = [study for study in study_input.studies if study.needs_cells]
    for study in without_cells:
        yield from study.description(study_input.scene, study_input.options(study))
    if cells is not None:
        yield "cells", _cells_text(study_input, cells)
    for study in with_cells:
        yield from study.description(study_input.scene, study_input.options(study))


def _cells_text(study_input: StudyInput, cells: Shape) -> str:
    """Return the number of cells and their size as text, with a recommendation if the cells contain few waves."""
    sides = [side / m for side, m in zip(study_input.scene.surface.size, cells, strict=True)]
    n_waves = [side / study_input.conditioning.shortest_wave for side in sides]
    size = " × ".join(to_text(side, "m", 3) for side in sides)
    text = f"{cells[0]} × {cells[1]} of about {size}, that is {n_waves[0]:.3g} × {n_waves[1]:.3g} shortest waves"
    if min(n_waves) < ADVISED_WAVES * 0.99:  # with a tolerance for rounding
        text += f"; {ADVISED_WAVES} or more are advised, which takes a larger face"
    return text
