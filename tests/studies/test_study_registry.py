"""Studies are registered once: solved by name they are what their functions give, and each knows what it answers."""

import numpy as np

import femseal as fs
from femseal.studies import STUDIES, Sampling, StudyOptions, study_of_result
from femseal.studies.costs import usual_efforts
from femseal.topography import self_affine

CELLS = (4, 4)
SAMPLING = Sampling(length=200e-6, realisations=3, seed=1)


def small_scene():
    face = self_affine((48, 48), (48e-6, 48e-6), hurst=0.8, rms_slope=0.2, roll_off=24e-6, rng=3)
    return fs.Scene(face, 115e9, 3e9, fs.Liquid(1e-3), 1e6, 0.0, loading=(1e8, 3e8))


def test_a_registered_study_is_what_its_function_gives():
    scene = small_scene()
    options = StudyOptions(CELLS, SAMPLING)
    own = {
        "deterministic": fs.deterministic(scene),
        "two-scale": fs.two_scale(scene, CELLS),
        "blocks": fs.by_blocks(scene, (1, 1)),
        "stochastic": fs.stochastic(scene, CELLS, SAMPLING),
    }
    assert list(STUDIES) == list(own)
    for name, study in STUDIES.items():
        result = study.solve(scene, options, map)
        assert study_of_result(result) is study
        np.testing.assert_array_equal(study.leakage(result), study.leakage(own[name]))
        seconds, memory = study.cost(scene, options, usual_efforts(len(scene.steps)))
        assert 0 < seconds < 3600
        assert 0 < memory < 1e9
        less, _ = study.cost(
            scene, StudyOptions(CELLS, SAMPLING, knows_face=True), usual_efforts(len(scene.steps))
        )
        assert less < seconds or name in ("deterministic", "blocks")


def test_every_study_names_the_variable_that_answers():
    names = [study.leakage_variable for study in STUDIES.values()]
    assert names == [
        "leakage_deterministic",
        "leakage_two_scale",
        "leakage_blocks",
        "leakage_median",
    ]
