"""Every picture of a run is drawn by its name, or says what the run lacks."""

import pytest
from small_cases import steel_scene

import femseal as fs
from femseal.base import InputError
from femseal.results import assemble


def test_pictures_of_a_run_have_names():
    face = fs.self_affine((32, 32), (4e-5, 4e-5), hurst=0.8, rms_slope=0.2, cut_off=1e-5, rng=1)
    scene = steel_scene(face, loading=(5e7, 1e8), unload_from=(1e8,), unloading=(5e7,))
    results = assemble(scene, fs.two_scale(scene, (2, 2)))
    assert len(results.plot().axes) == len(results.plot.leakage().axes) > 0
    for figure in (results.plot.cells(), results.plot.seal(), results.plot.seal(step=0)):
        assert figure.axes
    for name, lacking in (("test", "test_fluid"), ("realisation", "stochastic")):
        with pytest.raises(InputError, match=lacking):
            getattr(results.plot, name)()
    assert "plot.cells()" in repr(results.plot)
    assert {"leakage", "cells", "seal", "realisation", "test"} <= set(dir(results.plot))
    with pytest.raises(InputError):
        results.plot(colour="red")
