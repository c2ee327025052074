"""The forecast of a run: it follows sizes, loads and methods, and refuses what does not fit into memory."""

import re
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from small_cases import small_turned_seal

import femseal as fs
from femseal.case import parse_case
from femseal.preparation import prepare
from femseal.report.page import report_html
from femseal.runs import forecast as module
from femseal.runs import run_description
from femseal.runs.disk_space import disk_space
from femseal.runs.forecast import forecast
from femseal.runs.run_description import describe
from femseal.studies import STUDIES, StudyOptions
from femseal.studies.sampling import FEWEST_BY_DEFAULT, MOST_BY_DEFAULT

ROOT = Path(__file__).parents[2]


@pytest.fixture
def data():
    return small_turned_seal() | {"method": "deterministic", "compare": []}


@pytest.fixture
def memory(monkeypatch):
    """A machine with so many bytes free."""
    return lambda size: monkeypatch.setattr(module, "free_memory", lambda: size)


def of(data):
    """A case and what is prepared of it."""
    case = parse_case(data)
    return case, prepare(case)


def test_forecast_adds_up_the_methods(data):
    one, two = (forecast(*of(data | {"compare": compare})) for compare in ([], ["two-scale"]))
    assert (
        two.parallel_seconds >= one.parallel_seconds
    )  # contact and flow of the face are those of both
    assert two.serial_seconds >= one.serial_seconds
    assert_allclose(one.seconds(2), one.serial_seconds + one.parallel_seconds / 2)


@pytest.mark.parametrize("fluid_pressure", ["acts", "ignored"])
def test_the_range_of_time_contains_the_time_of_a_run(data, fluid_pressure):
    """Of contact and flow of a larger surface, by the time of the processor; a machine may be three times as fast."""
    data["face"] |= {"points": [256, 256], "size": ["240 um", "240 um"]}
    data |= {"load": {"loading": ["100 MPa", "300 MPa"]}, "output": {"budget": False}}
    case, prepared = of(data | {"contact": {"fluid_pressure": fluid_pressure}})
    expected = replace(forecast(case, prepared), serial_seconds=0.0)
    fs.deterministic(prepared.scene)  # compiles the loops
    start = time.process_time()
    fs.deterministic(prepared.scene)
    taken = time.process_time() - start
    shortest, longest = expected.range_seconds()
    assert shortest / 3 < taken < 3 * longest


def test_elimination_may_take_more_memory_than_is_forecast_for_multigrid(data):
    """It is stated where it matters, and does not exceed that of dense fronts on a grid, 31 n log2 n numbers."""
    data["face"] |= {"points": [512, 512], "size": ["240 um", "240 um"]}
    case, prepared = of(data | {"output": {"budget": False}})
    expected = forecast(case, prepared)
    nodes = 512**2
    assert 0 < expected.most_memory - expected.memory < 8 * 31 * nodes * np.log2(nodes)
    (line,) = (text for text in describe(case, prepared) if text.startswith("expected"))
    assert (
        f"({expected.most_memory / 1e9:.1f} GB if a flow has to be solved by elimination)" in line
    )


def test_time_grows_with_pixels_and_load_steps(data):
    def work(**changes):
        return forecast(*of(data | {"output": {"budget": False}} | changes)).parallel_seconds

    loads = ["50 MPa", "100 MPa"]
    once, twice = (work(load={"loading": some}) for some in (loads[:1], loads))
    assert_allclose(twice, 2 * once)
    larger = data["face"] | {"points": [128, 192]}
    assert_allclose(work(load={"loading": loads}, face=larger), 4 * twice)


def test_a_run_that_does_not_fit_is_refused_unless_the_case_says_so(data, memory, tmp_path):
    case, prepared = of(data)
    needed = forecast(case, prepared).memory
    memory(0.501e9)
    assert needed > 0.501e9
    said = rf"memory: given a run that takes about {needed / 1e9:.3g} GB.*on 64 × 96 points"
    with pytest.raises(fs.InputError, match=rf"{said}.*0\.501 GB that are free.*surface\.points"):
        fs.run(case, tmp_path / "results", workers=1)
    assert not (tmp_path / "results").exists()
    data |= {"memory": "2 GB", "load": {"loading": ["100 MPa"]}}
    assert parse_case(data).echo() == parse_case(data | {"memory": "3 GB"}).echo()
    assert fs.run(parse_case(data), workers=1).leakage.values[0] > 0
    memory(1e12)
    said = r"0\.1 GB of the key memory: more than the 0\.5 GB that any run takes"
    with pytest.raises(fs.InputError, match=said):
        fs.run(parse_case(data | {"memory": "100 MB"}), workers=1)


def test_large_states_take_disk_and_no_memory(data):
    """Large is what takes more than a sixteenth of the memory that the case allows."""
    ends = []
    for memory in ("2 GB", "1 MB"):
        case, prepared = of(data | {"memory": memory})
        ends.append((forecast(case, prepared).memory, disk_space(case, prepared).checkpoint))
    states = (4 + 4 + 4 + 4 + 0.125) * 64 * 96 * len(prepared.scene.steps)
    assert_allclose(np.subtract(*ends), [states, -states])


@pytest.mark.parametrize(
    ("tables", "said"),
    [
        ({"face": {"points": [512, 768]}}, r"expected .* on one core, .*on the \d+ of this mach"),
        (
            {"load": {"loading": ["0 MPa"]}, "material": {}},
            "times the smallest load, as a part of the load",
        ),
        (
            {"method": "stochastic", "stochastic": {"length": "1 mm"}},
            "states of the face, at its loads; cells stay in their rows",
        ),
        (
            {"method": "stochastic", "stochastic": {"length": "1 mm", "breadth": "0.5 mm"}},
            "about 25 states of the face, at tabulated pressures",
        ),
    ],
)
def test_check_describes_what_a_run_does(data, tables, said, monkeypatch):
    monkeypatch.setattr(run_description.psutil, "cpu_count", lambda: 4)
    data["face"] |= tables.get("face", {})
    if tables.get("material") == {}:  # elastic faces that just touch
        tables = tables | {"material": {"young": "210 GPa"}, "counter_material": {"young": "7 GPa"}}
    lines = "\n".join(describe(*of(data | tables | {"face": data["face"]})))
    assert re.search(said, lines)
    assert "inf" not in lines.split()


def test_one_load_is_named_in_the_singular(data):
    drawn = {"realisations": 2}
    data |= {"method": "stochastic", "load": {"loading": ["50 MPa"]}, "stochastic": drawn}
    case, prepared = of(data)
    results = fs.run(case, workers=1)
    texts = [*describe(case, prepared), *results.warnings, results._repr_html_()]
    things = "state|step|load|seal|realisation|cell|tile|cell|row|column|solution"
    for text in [*texts, report_html(results)]:
        plain = re.sub(r"<[^>]*>", " ", text)
        assert not (found := re.findall(rf"(?<![×.]) 1 (?:\w+ )?(?:{things})s\b.*", plain)), found


def test_seals_as_many_as_their_scatter_asks_for_are_forecast_as_a_range(data):
    """Between the work of the fewest and of the most seals, which a case may ask for itself."""
    drawn = {"length": "20 mm", "breadth": "1 mm"}
    data |= {"method": "stochastic", "output": {"budget": False}}

    def foreseen(more):
        return forecast(*of(data | {"stochastic": drawn | more}))

    open_number = foreseen({})
    assert_allclose(
        open_number.parallel_seconds,
        foreseen({"realisations": FEWEST_BY_DEFAULT}).parallel_seconds,
        rtol=1e-12,
    )
    most = foreseen({"realisations": MOST_BY_DEFAULT})
    assert_allclose(
        [open_number.most_parallel_seconds, most.most_parallel_seconds],
        most.parallel_seconds,
        rtol=1e-12,
    )
    assert open_number.most_parallel_seconds > 3 * open_number.parallel_seconds
    texts = [
        "\n".join(describe(*of(data | {"stochastic": drawn | m})))
        for m in ({}, {"realisations": 9})
    ]
    said = r"\S+ \S+ to \S+ \S+ on one core.*\(3 to 200 seals, depending on their scatter\)"
    assert re.search(said, texts[0])
    assert "depending on their scatter" not in texts[1]


def test_drawn_seals_take_longer_at_several_fluid_pressures(data):
    """Permeabilities that depend on the fluid pressure take several solutions of a seal."""
    drawn = {"length": "20 mm", "breadth": "1 mm", "realisations": 50}
    data |= {"method": "stochastic", "stochastic": drawn, "output": {"budget": False}}
    acts, ignored = (
        forecast(*of(data | {"contact": {"fluid_pressure": how}})).parallel_seconds
        for how in ("acts", "ignored")
    )
    assert 1.5 * ignored < acts < 20 * ignored


def test_a_gas_with_slip_takes_longer():
    """Cells at several pressures, and other flow solved again and again."""
    sampling = fs.Sampling(length=1e-2, realisations=9, seed=1)
    options = StudyOptions((8, 16), sampling)
    face = fs.self_affine((256, 512), (256e-6, 512e-6), hurst=0.8, rms_slope=0.1, rng=1)
    loads, ends = {"loading": (1e8, 2e8, 3e8, 4e8)}, ((False, 5e5), (True, 5e5), (True, 1e4))
    scenes = [
        fs.Scene(face, 115e9, 3e9, fs.IdealGas(1.8e-5, 0.029, 293.0, slip), 1e6, outlet, **loads)
        for slip, outlet in ends
    ]
    for name in ("deterministic", "two-scale", "stochastic"):
        still, slips, wide = (STUDIES[name].cost(scene, options).seconds for scene in scenes)
        assert still < slips <= wide < 6 * still


def test_a_filter_that_removes_nothing_removes_zero_percent(data):
    """Rounding can make the slope after conditioning larger than before in the last digits."""
    case, prepared = of(data)
    conditioning = prepared.conditioning
    slope = prepared.scene.surface.rms_slope * (1 - 1e-12)
    prepared = replace(prepared, conditioning=replace(conditioning, rms_slope_before=slope))
    text = "\n".join(describe(case, prepared))
    assert "with 0% of the rms slope" in text
    assert "-0%" not in text
