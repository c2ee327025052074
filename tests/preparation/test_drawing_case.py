"""A case from a drawing: its surface has the roughness of the drawing, questions, and what is refused."""

import tomllib

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.ndimage import gaussian_filter1d

from femseal.base import InputError
from femseal.case.reading import parse_case
from femseal.materials import METALS
from femseal.preparation import case_of_drawing as drawing
from femseal.preparation.case_of_drawing import case_of_drawing
from femseal.preparation.drawing_check import (
    drawing_text,
    drawing_warnings,
    spacing_of_periodic_marks,
)
from femseal.preparation.drawing_values import QUESTIONS, read_drawing
from femseal.preparation.preparation import prepare
from femseal.preparation.surface import condition_surface
from femseal.topography.profile_roughness import profile_roughness

TURNED = {
    "ra": "1.6um",
    "pitch": "0.15mm",
    "inner_diameter": "50 mm",
    "outer_diameter": "53.6 mm",
    "force": "80 kN",
    "limit": "1e-3 mbar*L/s",
}


@pytest.fixture(autouse=True)
def few_points(monkeypatch):
    """A tenth of the points, so that surfaces are generated at once."""
    monkeypatch.setattr(drawing, "_FIRST_POINTS", 4e4)


def case_of(**given):
    return parse_case(tomllib.loads(case_of_drawing(read_drawing(given, None))))


def test_a_ground_surface_has_the_ra_of_the_drawing_as_a_tester_measures_it():
    """Ra of 0.8 µm is measured behind a filter of 0.8 mm, whatever the spacing of the marks."""
    case = case_of(**TURNED | {"ra": "0.8um", "process": "ground", "pitch": "60um"})
    surface = condition_surface(case).surface
    # the weighting function of the filter, exp(−π(x/αλ)²), has the standard deviation αλ/√(2π), with α² = ln 2/π
    deviation = np.sqrt(np.log(2) / np.pi) * 0.8e-3 / np.sqrt(2 * np.pi) / surface.spacing[0]
    mean_line = gaussian_filter1d(surface.heights, deviation, axis=0, mode="reflect", truncate=6.0)
    roughness = surface.heights - mean_line
    assert_allclose(np.abs(roughness - roughness.mean(axis=0)).mean(), 0.8e-6, rtol=0.01)
    (face,) = case.face
    assert spacing_of_periodic_marks(face) is None
    (turned,) = case_of(**TURNED).face
    assert spacing_of_periodic_marks(turned) == pytest.approx(0.15e-3)


@pytest.mark.parametrize(
    "given",
    [
        TURNED,
        TURNED | {"process": "ground", "lay": "radial", "pitch": "60um"},
        {"rz": "4um", "process": "lapped", "metal": "silver, annealed"},
        {
            "rz": "20um",
            "process": "turned",
            "pitch": "0.3mm",
            "outer_diameter": "60mm",
            "lay": "spiral",
        },
        # near the limits between two filters: Ra 0.1 µm, and Rz 0.5 µm
        {"ra": "0.09um", "process": "ground", "pitch": "60um"},
        {"ra": "0.1um", "process": "blasted"},
        {"rz": "0.5um", "process": "ground", "pitch": "60um"},
    ],
)
def test_the_surface_has_the_roughness_of_the_drawing(given):
    case = case_of(**given)
    surface = condition_surface(case).surface
    (face,) = case.face
    stated = {"ra": face.ra, "rz": face.rz}
    found = profile_roughness(surface, spacing_of_periodic_marks(face), **stated)
    key = "ra" if "ra" in given else "rz"
    assert getattr(found, key) == pytest.approx(getattr(face, key), rel=0.01)
    assert not list(drawing_warnings(case, surface))
    text = drawing_text(case, surface)
    for words in ("Ra", "Rz", "Sq", "rms slope"):
        assert words in text


def test_another_surface_than_that_of_the_drawing_is_warned_of():
    case = case_of(**TURNED)
    (face,) = case.face
    changed = {"depth": 1.5 * face.depth, "roughness": 1.5 * face.roughness}
    case = case.model_copy(update={"face": (face.model_copy(update=changed),)})
    (warning,) = drawing_warnings(case, condition_surface(case).surface)
    assert "Ra is 2.4 µm, the drawing states 1.6 µm" in warning
    assert "by 0.667" in warning
    assert warning in prepare(case).warnings


def test_the_surface_is_as_broad_as_the_seal_and_its_cells_stay_in_order():
    case = case_of(**TURNED)
    prepared = prepare(case)
    assert_allclose(prepared.scene.surface.size, [1.8e-3, 3.6e-3], rtol=1e-6)
    assert prepared.cut_and_tiles[1].in_order
    assert_allclose(case.stochastic.length, np.pi * 51.8e-3, rtol=1e-4)
    # 80 kN over the ring
    area = np.pi / 4 * (53.6e-3**2 - 50e-3**2)
    assert_allclose(max(prepared.scene.steps.pressures), 80e3 / area, rtol=1e-3)
    broad = case_of(**TURNED | {"outer_diameter": "70 mm", "force": "500 kN"})
    assert broad.stochastic.breadth == pytest.approx(10e-3)
    assert broad.face[0].size[0] == pytest.approx(16 * 0.15e-3)
    # what is not given follows from usual values, which the file marks
    text = case_of_drawing(read_drawing({"ra": "1.6um", "pitch": "0.15mm"}, None))
    assert 'name = "copper, soft"                             # assumed: ' in text
    assert "30 % of the hardness" in text


@pytest.mark.parametrize(
    ("changes", "what"),
    [
        ({"ra": None}, "--ra, --rz"),
        ({"rz": "8um"}, "--ra, --rz"),
        ({"pitch": None}, "--pitch"),
        ({"pitch": "3mm"}, "--pitch"),
        ({"process": "honed"}, "--process"),
        ({"lay": "crossed"}, "--lay"),
        ({"outer_diameter": "40mm"}, "--outer-diameter"),
        ({"hardness": "soft HV"}, "--hardness"),
        ({"force": "800 kN"}, "--force"),
        ({"force": "-1 kN"}, "--force"),
        ({"ra": "0 um"}, "--ra"),
        ({"hardness": "-45 HV"}, "--hardness"),
        ({"plating": "silver, annealed"}, "--plating-thickness"),
        ({"plating_thickness": "20 um"}, "--plating"),
        ({"plating_hardness": "60 HV"}, "--plating"),
        ({"plating": "unobtainium", "plating_thickness": "20 um"}, "--plating"),
        ({"plating": "silver, annealed", "plating_thickness": "0 um"}, "--plating-thickness"),
        # 80 kN are 273 MPa, more than the hardness of annealed silver
        ({"plating": "silver, annealed", "plating_thickness": "20 um"}, "--force"),
    ],
)
def test_what_no_drawing_states_is_refused(changes, what):
    with pytest.raises(InputError) as caught:
        read_drawing(TURNED | changes, None)
    assert caught.value.what == what


def test_questions_are_asked_for_what_is_missing_alone():
    asked = []

    def ask(text, assumed):
        asked.append(text)
        return {"pitch": "0.15 mm"}.get(next(n for n, q in QUESTIONS.items() if q.text == text), "")

    found = read_drawing({"ra": "1.6um", "metal": "silver, annealed"}, ask)
    assert found.pitch == 0.15e-3
    assert "metal" in QUESTIONS
    assert QUESTIONS["ra"].text not in asked
    assert QUESTIONS["rz"].text not in asked
    assert QUESTIONS["metal"].text not in asked
    assert QUESTIONS["force"].text in asked
    # Ra, Rz and the metal are not asked for, nor the properties of a plating that the user does not name
    assert len(asked) == len(QUESTIONS) - 5


def test_a_plating_is_asked_for_and_written_as_the_coating_of_the_softer_face():
    answers = {"plating": "silver, annealed", "plating_thickness": "30 um"}
    asked = []

    def ask(text, assumed):
        name = next(n for n, q in QUESTIONS.items() if q.text == text)
        asked.append(name)
        return answers.get(name, "")

    given = {"ra": "1.6um", "pitch": "0.15mm", "metal": "inconel 718, aged"}
    found = read_drawing(given, ask)
    assert {"plating", "plating_thickness", "plating_hardness"} <= {*asked}
    made = parse_case(tomllib.loads(case_of_drawing(found)))
    silver, inconel = METALS["silver, annealed"][0], METALS["Inconel 718, aged"][0]
    coating = made.material.coating
    assert coating.thickness == pytest.approx(30e-6)
    assert coating.young == silver.young
    assert coating.hardness == pytest.approx(silver.hardness, rel=1e-2)
    assert made.material.hardness == pytest.approx(inconel.hardness, rel=1e-2)
    # the force that is assumed is 0.3 of the hardness of the plating
    area = np.pi / 4 * (54e-3**2 - 50e-3**2)
    assert found.force == pytest.approx(0.3 * silver.hardness * area, rel=0.05)
    harder = case_of(**given | answers | {"plating_hardness": "60 HV"})
    assert harder.material.coating.hardness == pytest.approx(60 * 9.80665e6 / 0.9272, rel=1e-2)
    # a hardness that the user has measured is not compared with the typical one
    assert harder.named_warnings == ()
    assert harder.material.coating.young == pytest.approx(silver.young, rel=1e-3)


def test_hardness_of_metals_is_that_of_an_indentation():
    """1 HV is 1 kgf/mm² over 1/0.9272 of the projected area; annealed metals are harder than 2.8 yield stresses."""
    found = read_drawing(TURNED | {"hardness": "50 HV"}, None)
    assert found.hardness == pytest.approx(50 * 9.80665e6 / 0.9272)
    for name, (solid, _source) in METALS.items():
        if "annealed" in name or "soft" in name:
            assert solid.hardness > 1.3 * 2.8 * solid.yield_stress


@pytest.mark.slow
def test_a_case_from_a_drawing_runs_as_it_is(tmp_path, femseal):
    path = tmp_path / "seal.toml"
    options = [
        f"--{'class' if n == 'limit' else n.replace('_', '-')}={v}" for n, v in TURNED.items()
    ]
    code, printed, _ = femseal("new", path, "--drawing", *options)
    assert code == 0
    assert "run it as it is" in printed
    code, printed, _ = femseal("run", path, "-o", tmp_path / "results", "--workers", "1")
    assert code == 0
    assert "At most 0.001 mbar·L/s of helium" in " ".join(printed.split())


def test_options_of_a_drawing_need_it(tmp_path, femseal):
    path = tmp_path / "seal.toml"
    code, _, error = femseal("new", path, "--ra", "1.6um")
    assert code == 2
    assert "--drawing" in error
    code, _, error = femseal("new", path, "--drawing", "--pitch", "0.15mm")
    assert code == 2
    assert "--ra, --rz" in error
    assert not path.exists()
    code, _, _ = femseal("new", path, "--drawing", "--ra", "1.6um", "--pitch", "0.15mm")
    assert code == 0
    code, printed, _ = femseal("check", path)
    assert code == 0
    assert "Ra 1.6 µm" in printed


def test_the_softer_one_of_a_plating_and_its_base_limits_the_force():
    hard = {
        "plating": "silver, annealed",
        "plating_thickness": "20 um",
        "plating_hardness": "200 HV",
    }
    case = case_of(**TURNED | {"metal": "copper, soft"} | hard)
    prepare(case)  # the assumed force is below the hardness of the copper
    with pytest.raises(InputError, match=r"less than the hardness, 476 MPa"):
        case_of(**TURNED | {"metal": "copper, soft", "force": "400kN"} | hard)
