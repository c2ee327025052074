"""Plausibility warnings of results: the same in Python as in a run, and of the leakage of each study."""

from dataclasses import replace

import numpy as np
import pytest
from small_cases import HARDENED, steel_scene

import femseal as fs
from femseal.case import parse_case
from femseal.checks import estimate_scene, estimate_surface, result_warnings
from femseal.checks.quick_estimate import LIGHT_CONTACT
from femseal.preparation import prepare
from femseal.studies.block_division import blocks_of
from femseal.studies.blocks import by_blocks

FACE = {
    "kind": "self-affine",
    "points": [64, 64],
    "size": ["1 mm", "1 mm"],
    "hurst": 0.8,
    "rms_height": "3 um",
    "roll_off": "300 um",
}
FINE = FACE | {"points": [128, 128]}
#: Nitrogen of 200 bar through gaps of micrometres: the computed flow is faster than sound, and inertia counts.
FAST_GAS = HARDENED | {
    "face": FACE,
    "material": {"young": "210 GPa", "yield_stress": "1 GPa"},
    "load": {"loading": ["25 MPa"]},
    "fluid": {"name": "nitrogen", "inlet_pressure": "200 bar"},
    "contact": {"fluid_pressure": "ignored"},
    "output": {"budget": False},
}
SEAL = {"length": "4 mm", "realisations": 2}
#: A map that presses no more than the fluid carries over a part of the seal.
BARE = {"kind": "profile", "fractions": [0.2, 1.8]}


def solve_in_python(prepared, method):
    """Solve a study as a user of the Python functions does."""
    scene, cells = prepared.scene, prepared.cells
    if method == "deterministic":
        return fs.deterministic(scene)
    if method == "two-scale":
        return fs.two_scale(scene, cells)
    if method == "blocks":
        return by_blocks(scene, blocks_of(cells))
    return fs.stochastic(scene, cells, prepared.sampling)


@pytest.mark.parametrize(
    "tables",
    [
        {"method": "deterministic"},
        {"method": "two-scale", "cells": {"count": [2, 2]}},
        pytest.param(
            {"method": "blocks", "cells": {"count": [8, 8]}, "face": FINE}, marks=pytest.mark.slow
        ),
        {"method": "stochastic", "cells": {"count": [2, 2]}, "stochastic": SEAL},
        {
            "method": "stochastic",
            "compare": ["deterministic"],
            "cells": {"count": [2, 2]},
            "stochastic": SEAL | {"breadth": "2 mm"},
        },
    ],
    ids=["deterministic", "two-scale", "blocks", "in order", "at random"],
)
def test_python_functions_warn_of_what_a_run_warns_of(tables):
    case = parse_case(FAST_GAS | tables)
    prepared = prepare(case)
    of_case = set(prepared.warnings)
    of_run = set(fs.run(case, workers=1).warnings)
    of_python = set(solve_in_python(prepared, tables["method"]).warnings)
    assert of_python - of_case == of_run - of_case
    assert sum("choked nozzle" in text for text in of_python) == 1
    assert sum("Reynolds number" in text for text in of_python) == 1


@pytest.mark.parametrize("method", ["deterministic", "stochastic"])
def test_a_run_warns_of_a_test_gas_faster_than_sound(method):
    """The fluid in service is an oil, whose leakage is plausible."""
    oil = {"kind": "liquid", "viscosity": "50 mPa*s", "inlet_pressure": "10 bar"}
    output = FAST_GAS["output"] | {"test_fluid": FAST_GAS["fluid"]}
    seal = {"cells": {"count": [2, 2]}, "stochastic": SEAL} if method == "stochastic" else {}
    case = FAST_GAS | {"method": method, "fluid": oil, "output": output} | seal
    texts = fs.run(parse_case(case), workers=1).warnings
    of_gas = [text for text in texts if "choked nozzle" in text]
    assert len(of_gas) == 1
    assert of_gas[0].startswith("Test fluid: ")


def test_python_functions_warn_of_a_map_as_a_run_does():
    seal = {"stochastic": SEAL, "cells": {"count": [2, 2]}, "method": "stochastic"}
    load = {"load": {"loading": ["25 MPa"], "map": BARE}, "contact": {"fluid_pressure": "acts"}}
    case = parse_case(FAST_GAS | seal | load)
    prepared = prepare(case)
    result = solve_in_python(prepared, "stochastic")
    (of_map,) = (text for text in prepared.warnings if "tiles just touch there" in text)
    assert of_map in result.warnings


ROUGH = fs.self_affine((128, 128), (1e-3, 1e-3), hurst=0.8, rms_height=5e-7, roll_off=125e-6, rng=1)


@pytest.mark.parametrize("ratio", [1e-3, 1e3])
def test_leakage_far_from_the_quick_estimate_is_warned_of(ratio):
    """Whatever the direction of the flow, but not where the spectrum does not tell."""
    scene = steel_scene(ROUGH, loading=(25e6,))
    result = fs.deterministic(scene)
    assert result.warnings == ()
    wrong, gap = ratio * result.leakage, np.full(1, np.nan)
    (text,) = result_warnings(scene, wrong, gap, estimate_scene(scene))
    assert "times the quick estimate" in text
    reverse = replace(scene, inlet_pressure=0.0, outlet_pressure=1e6)
    assert result_warnings(reverse, -wrong, gap, estimate_scene(reverse)) == (text,)
    assert result_warnings(scene, wrong, gap, None) == ()


def test_a_surface_that_touches_by_its_form_is_not_compared_with_its_spectrum():
    """A crown of 20 µm on a roughness of 0.5 µm leaks thousands of times less than its spectrum tells."""
    crown = -2e-5 * np.linspace(-1, 1, 128) ** 2
    scene = steel_scene(ROUGH.with_form(crown), loading=(100e6,))
    by_spectrum = estimate_surface(scene.surface, scene.modulus, scene.hardness, [100e6])
    result = fs.deterministic(scene)
    assert result.leakage[0] < 1e-3 * scene.unit_leakage * by_spectrum.permeability[0]
    assert by_spectrum.area[0] < LIGHT_CONTACT
    assert result.warnings == ()
