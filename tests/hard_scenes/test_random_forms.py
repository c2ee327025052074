"""Contacts of seals with a form, drawn at random: any roughness, hardness, form, load and history."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

import femseal as fs
from femseal.seal import AnnularLayout, MeasuredForm, RectangularLayout, WavyForm
from femseal.studies import Sampling, cut_and_cover
from femseal.studies.seal_contact import solve_seal_contact

D = 1e-6
#: Seeds with slopes that a half-space does not allow, or points that do not cover the seal.
REFUSED = {25, 29, 42, 43}


def drawn(seed):
    """A scene, the options of its seal, and its form."""
    rng = np.random.default_rng(seed)
    n, hardness = (
        int(rng.choice([32, 48, 64])),
        np.inf if rng.random() < 0.25 else 10 ** rng.uniform(8, 10),
    )
    modulus, side = 10 ** rng.uniform(9.5, 11.5), n * D
    face = fs.self_affine((n, n), (side, side), hurst=rng.uniform(0.3, 1), rms_slope=10 ** rng.uniform(-4, -0.3),
                          roll_off=side / 2, cut_off=8 * D, rng=seed)  # fmt: skip
    top = 0.855 * min(hardness, 0.1 * modulus) * 10 ** rng.uniform(-3, 0)
    loads = tuple(sorted(top * np.r_[1, 10 ** rng.uniform(-4, 0, 2)]))
    strip = rng.integers(3) == 0
    if strip:
        length, breadth = side * rng.uniform(3, 60), side * rng.uniform(1.5, 12)
        layout, largest = RectangularLayout(), np.array([breadth, length])
    else:
        length = breadth = None
        inner = side * rng.uniform(3, 60)
        layout, largest = (
            AnnularLayout(inner, inner + side * rng.uniform(1.5, 12)),
            inner + 12 * side,
        )
    height = 10 ** rng.uniform(-9, -4.5)
    if rng.random() < 0.5:
        form = WavyForm(height, lobes=int(rng.integers(1, 9)))
    else:
        points = (
            rng.uniform(0, 1, (60, 2)) if strip else rng.uniform(-1.2, 1.2, (60, 2))
        ) * largest
        form = MeasuredForm.from_points(points, rng.normal(0, height, 60))
    scene = fs.Scene(face, modulus, hardness, fs.Liquid(1e-3), 1.0, 0.0, loading=loads, unload_from=(loads[-1],),
                     unloading=tuple(loads[-1] * f for f in (0.6, 0.1, 0.001)), fluid_pressure="ignored",
                     layout=layout)  # fmt: skip
    return scene, Sampling(length, seed=1, breadth=breadth, form=form), form


@pytest.mark.parametrize(
    "seed", [0, 3, 7, 25, *(pytest.param(s, marks=pytest.mark.slow) for s in range(80))]
)
def test_any_form_carries_any_load(seed):
    """Cells press or stand apart, and never more than they can; faces that came back carry the load as well."""
    scene, sampling, form = drawn(seed)
    if seed in REFUSED:
        with pytest.raises(fs.InputError):
            contact_of(scene, sampling, form)
        return
    contact = contact_of(scene, sampling, form)
    inside = (
        contact.grid.inside if contact.pressure.shape[2] > 1 else np.ones(contact.depth.shape, bool)
    )
    assert_allclose(contact.pressure[:, inside].mean(axis=1), scene.steps.pressures, rtol=1e-3)
    assert (contact.pressure >= 0).all()
    assert contact.pressure.max() <= scene.law.capacity
    assert (contact.opening >= 0).all()
    assert (contact.pressure[contact.opening > 0] == 0).all()
    assert (contact.separation[:, inside] >= 0).all()


def contact_of(scene, sampling, form):
    """The contact of the seal."""
    _, tiles = cut_and_cover(scene.surface, scene.layout, None, sampling)
    return solve_seal_contact(scene, tiles, (form,))
