"""Studies are registered once: solved by name they are what their functions give, and each knows what it answers."""

from dataclasses import replace

import numpy as np
from small_cases import steel_scene

import femseal as fs
from femseal.studies import STUDIES, Sampling, StudyOptions, study_of_result
from femseal.studies.blocks import blocks_of
from femseal.topography import self_affine

CELLS = (4, 4)
SAMPLING = Sampling(length=200e-6, realisations=3, seed=1)


def test_a_registered_study_is_what_its_function_gives():
    face = self_affine((48, 48), (48e-6, 48e-6), hurst=0.8, rms_slope=0.2, roll_off=24e-6, rng=3)
    scene, options = steel_scene(face, loading=(1e8, 3e8)), StudyOptions(CELLS, SAMPLING)
    known = replace(options, surface_is_solved=True)
    own = {
        "deterministic": fs.deterministic(scene),
        "two-scale": fs.two_scale(scene, CELLS),
        "blocks": fs.by_blocks(scene, blocks_of(CELLS)),
        "stochastic": fs.stochastic(scene, CELLS, SAMPLING),
    }
    assert list(STUDIES) == list(own)
    for name, study in STUDIES.items():
        result = study.solve(scene, options, map)
        assert study_of_result(result) is study
        assert study_of_result(own[name]) is study
        np.testing.assert_array_equal(result.predicted_leakage, own[name].predicted_leakage)
        seconds, memory = study.cost(scene, options)
        assert 0 < seconds < 3600
        assert 0 < memory < 1e9
        assert study.cost(scene, known)[0] < seconds or name in ("deterministic", "blocks")
