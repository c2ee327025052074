"""The forecast of a run: it follows sizes, loads and methods, and refuses what does not fit into memory."""

import re
import tomllib
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

import femseal as fs
from femseal.case.case import parse_case
from femseal.preparation.preparation import prepare
from femseal.report.page import report_html
from femseal.runs import forecast as module
from femseal.runs import pilot
from femseal.runs.disk import disk
from femseal.runs.forecast import describe, forecast
from femseal.seal.layouts import RectangularLayout
from femseal.seal.tiles import PieceSize
from femseal.studies import face_flow, fluid_coupling
from femseal.studies.costs import (
    PILOT_PIXELS,
    Effort,
    contact_seconds,
    deterministic_cost,
    stochastic_cost,
    two_scale_cost,
    usual_efforts,
)
from femseal.studies.face_study import deterministic
from femseal.studies.fluid_coupling import FluidPressure

ROOT = Path(__file__).parents[2]


@pytest.fixture
def data():
    case = tomllib.loads((ROOT / "examples" / "turned_seal.toml").read_text(encoding="utf-8"))
    case["face"] |= {"points": [64, 96], "size": ["60 um", "120 um"], "pitch": "30 um"}
    case["cells"] = {"count": [2, 4]}
    return case | {"method": "deterministic", "compare": []}


@pytest.fixture
def memory(monkeypatch):
    """A machine with so many bytes free."""
    return lambda size: monkeypatch.setattr(module, "free_memory", lambda: size)


def test_the_effort_of_a_small_face_is_that_of_its_contacts(data):
    """With the fluid, at the lowest and the highest load, which are among those solved; between them it lies between."""
    scene = prepare(parse_case(data)).scene
    found = pilot.efforts(scene)
    half_space = fs.HalfSpace((64, 96), scene.surface.spacing, scene.modulus, ("mirror", "mirror"))
    gap = scene.surface.detrend().gap()
    for k in (0, len(scene.loading) - 1):
        settings = {"pressure": scene.loading[k], "hardness": scene.hardness, "rtol": scene.rtol}
        contact = scene.acting_fluid.contact(gap, half_space, **settings)
        assert_allclose(found[k].contact_fraction, contact.area_fraction)
        assert_allclose(
            found[k].pairs, contact.fft_pairs * (PILOT_PIXELS / gap.size) ** found[k].growth
        )
        assert found[k].rounds == contact.rounds
    shares = [effort.contact_fraction for effort in found[: len(scene.loading)]]
    assert shares == sorted(shares)
    assert len(found) == len(scene.steps)


@pytest.fixture
def counts(monkeypatch):
    """Rounds of contact and flow, transforms of contacts and iterations of flow, as they are solved."""
    found = Counter()
    flow, contact, coupled = (
        face_flow.cell_permeability,
        fluid_coupling.solve_contact,
        FluidPressure.contact,
    )

    def counting(name, number, solve):
        def counted(*arguments, **options):
            solution = solve(*arguments, **options)
            found[name] += number(solution)
            return solution

        return counted

    monkeypatch.setattr(
        face_flow, "cell_permeability", counting("iterations", lambda x: x.iterations, flow)
    )
    monkeypatch.setattr(
        fluid_coupling, "solve_contact", counting("pairs", lambda x: x.fft_pairs, contact)
    )
    monkeypatch.setattr(FluidPressure, "contact", counting("rounds", lambda x: x.rounds, coupled))
    return found


@pytest.mark.parametrize(
    "pressures", [["100 MPa", "200 MPa"], ["250 MPa", "500 MPa"]], ids=["open", "near closing"]
)
def test_the_pilot_counts_what_a_larger_face_takes(data, counts, pressures):
    """A face of nine times as many points, pressed apart: rounds, transforms and iterations within two fifths."""
    data["face"] = {
        "kind": "self-affine",
        "points": [600, 600],
        "size": ["600 um", "600 um"],
        "hurst": 0.8,
    }
    data["face"] |= {"rms_slope": 0.05, "roll_off": "60 um"}
    data |= {"load": {"loading": pressures}}
    data["fluid"] = {
        "kind": "liquid",
        "viscosity": "1 mPa*s",
        "inlet_pressure": "30 MPa",
        "outlet_pressure": "0 MPa",
    }
    scene = prepare(parse_case(data)).scene
    known, pixels = pilot.efforts(scene), scene.surface.heights.size
    counts.clear()
    deterministic(scene)
    assert_allclose(sum(effort.rounds for effort in known), counts["rounds"], rtol=0.4)
    assert_allclose(sum(e.rounds * e.pairs_on(pixels) for e in known), counts["pairs"], rtol=0.4)
    assert_allclose(
        sum(e.rounds * e.iterations_on(pixels) for e in known), counts["iterations"], rtol=0.4
    )


def test_the_effort_does_not_depend_on_the_points_of_a_large_face(data):
    data["face"] |= {"points": [256, 512], "size": ["240 um", "480 um"], "roughness": "1 um"}
    scene = prepare(parse_case(data)).scene
    larger = replace(
        scene, surface=fs.Topography(np.tile(scene.surface.heights, (2, 2)), scene.surface.spacing)
    )
    for one, other in zip(pilot.efforts(scene), pilot.efforts(larger), strict=True):
        assert 0.5 < one.pairs / other.pairs < 2
        assert abs(one.contact_fraction - other.contact_fraction) < 0.1


def test_a_contact_takes_longer_with_more_pixels_and_more_contact():
    assert (
        4
        < contact_seconds((2000, 2000), Effort(20, 0.0))
        / contact_seconds((1000, 1000), Effort(20, 0.0))
        < 6
    )
    assert contact_seconds((2000, 2000), Effort(20, 0.9)) > 3 * contact_seconds(
        (2000, 2000), Effort(20, 0.05)
    )


def test_rows_of_odd_and_prime_lengths_take_longer():
    lengths = (512, 450, 456, 675)
    seconds = [contact_seconds((2**20 // n, n), Effort(20, 0.1)) for n in lengths]
    assert seconds == sorted(seconds)
    assert seconds[-1] > 1.5 * seconds[0]


def test_forecast_adds_up_the_methods(data, monkeypatch):
    known = (Effort(),) * 30
    one = forecast(parse_case(data), prepare(parse_case(data)), known)
    data["compare"] = ["two-scale"]
    two = forecast(parse_case(data), prepare(parse_case(data)), known)
    assert two.work >= one.work  # contact and flow of the face are those of both
    assert two.own >= one.own
    monkeypatch.setattr(module, "pace", lambda: 3.0)
    assert_allclose(one.seconds(2), 3 * (one.own + one.work / 2))


def test_a_run_that_does_not_fit_is_refused_unless_the_case_says_so(
    data, memory, monkeypatch, tmp_path
):
    monkeypatch.setattr(module, "pace", lambda: pytest.fail("memory needs no time"))
    case = parse_case(data)
    needed = forecast(case, prepare(case)).memory / 1e9
    least = 0.501e9
    assert needed > least / 1e9
    memory(least)
    with pytest.raises(fs.InputError) as refused:
        fs.run(case, tmp_path / "results", workers=1)
    for words in (
        f"memory: given a run that takes about {needed:.3g} GB",
        "on 64 × 96 points",
        "0.501 GB that are free",
        "surface.points",
    ):
        assert words in str(refused.value)
    assert not (tmp_path / "results").exists()
    data |= {"memory": "2 GB", "load": {"loading": ["100 MPa"]}}
    assert fs.run(parse_case(data), workers=1).leakage.values[0] > 0
    memory(1e12)
    data["memory"] = "100 MB"
    with pytest.raises(
        fs.InputError, match=r"0\.1 GB of the key memory: more than the 0\.5 GB that any run takes"
    ):
        fs.run(parse_case(data), workers=1)


def test_large_states_take_disk_and_no_memory(data):
    """Large is what takes more than a sixteenth of the memory that the case allows."""
    ends = {}
    for memory in ("2 GB", "1 MB"):
        case = parse_case(data | {"memory": memory})
        prepared = prepare(case)
        ends[memory] = (
            forecast(case, prepared, usual_efforts(len(prepared.scene.steps))).memory,
            disk(case, prepared).checkpoint,
        )
    states = (4 + 4 + 1.125 + 0.125) * 64 * 96 * len(prepared.scene.steps)
    assert_allclose(np.subtract(ends["2 GB"], ends["1 MB"]), [states, -states])


def test_memory_is_no_part_of_the_results(data):
    assert parse_case(data | {"memory": "2 GB"}).echo() == parse_case(data).echo()


def test_check_tells_time_on_one_core_and_on_all(data, monkeypatch):
    monkeypatch.setattr(module.psutil, "cpu_count", lambda: 4)
    monkeypatch.setattr(module, "pace", lambda: 1.0)
    data["face"]["points"] = [512, 768]
    case = parse_case(data)
    (line,) = [line for line in describe(case, prepare(case)) if line.startswith("expected")]
    for words in (
        " on one core, ",
        "on the 4 of this machine",
        "GB of memory, and 0.25 GB or more for each further worker",
    ):
        assert words in line


def test_check_names_every_grid_of_the_error_budget_once_and_describes_a_flat_face(data, tmp_path):
    np.save(tmp_path / "flat.npy", np.zeros((256, 384)))
    data["face"] = {"path": str(tmp_path / "flat.npy"), "spacing": "0.5 um"}
    data["output"] = {"budget": True, "model_parts": ["hardness"]}
    case = parse_case(data)
    lines = [*describe(case, prepare(case))]
    (again,) = [line for line in lines if line.startswith("error budget")]
    assert re.findall(r"on (\d+ × \d+) points", again) == [
        *dict.fromkeys(re.findall(r"on (\d+ × \d+) points", again))
    ]
    assert any(line.endswith("rms slope 0: a flat face") for line in lines)


def test_check_describes_first_touch_alone(data):
    """At no load the contact takes no transforms, and the fluid carries no fraction of it."""
    data |= {
        "load": {"loading": ["0 MPa"]},
        "material": {"young": "210 GPa"},
        "counter_material": {"young": "70 GPa"},
    }
    case = parse_case(data)
    lines = [*describe(case, prepare(case))]
    assert any(line.endswith("with the contact") for line in lines)
    assert not any("inf" in line for line in lines)  # of the hardness of elastic faces


def test_one_load_is_named_in_the_singular(data):
    drawn = {"realisations": 2}
    data |= {"method": "stochastic", "load": {"loading": ["50 MPa"]}, "stochastic": drawn}
    case = parse_case(data)
    lines = [*describe(case, prepare(case))]
    assert any("1 state: 1 loading" in line for line in lines)
    results = fs.run(case, workers=1)
    texts = [*lines, *results.warnings, results._repr_html_(), report_html(results)]
    things = "state|step|load|seal|realisation|piece|tile|cell|row|column|solution"
    for text in texts:
        plain = re.sub(r"<[^>]*>", " ", text)
        assert not (found := re.findall(rf"(?<![×.]) 1 (?:\w+ )?(?:{things})s\b.*", plain)), found


def test_check_says_which_states_seals_are_drawn_from(data):
    data |= {"method": "stochastic", "stochastic": {"length": "1 mm"}}
    facts = "\n".join(describe(case := parse_case(data), prepare(case)))
    assert "states of the face, at its loads; pieces stay in their rows" in facts
    assert "as many as the band of error needs" in facts
    data["stochastic"]["breadth"] = "0.5 mm"
    data["stochastic"]["realisations"] = 7
    facts = "\n".join(describe(case := parse_case(data), prepare(case)))
    assert "about 25 states of the face, on a ladder of nominal pressures" in facts
    assert "7 seals of " in facts


def test_drawn_seals_take_longer_at_several_fluid_pressures(data):
    """Permeabilities that depend on the fluid pressure take several solutions of a seal."""
    drawn = {"length": "20 mm", "breadth": "1 mm", "realisations": 50}
    data |= {"method": "stochastic", "stochastic": drawn, "output": {"budget": False}}
    work = []
    for how in ("acts", "ignored"):
        case = parse_case(data | {"contact": {"fluid_pressure": how}})
        work.append(forecast(case, prepare(case)).work)
    assert 1.5 * work[1] < work[0] < 20 * work[1]


def test_a_gas_with_slip_takes_longer():
    """Pieces at several pressures, and other flow solved again and again."""
    efforts, points, cells = usual_efforts(4), (256, 512), (8, 16)
    sampling = fs.Sampling(length=1e-2, realisations=9, seed=1)
    tiles = RectangularLayout().lay_out(PieceSize((1e-4, 1e-4), 8, 1e-2))
    for cost in (
        lambda n: deterministic_cost(efforts, points, n),
        lambda n: two_scale_cost(efforts, points, cells, pressures=n),
        lambda n: stochastic_cost(efforts, points, cells, tiles, sampling, pressures=n),
    ):
        still, slips, wide = (cost(n)[0] for n in (1, 4, 6))
        assert still < slips <= wide < 6 * still
