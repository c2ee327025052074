"""What depends on code of users is not stored."""

import types

from numpy.testing import assert_allclose
from small_cases import steel_scene

import femseal as fs
from femseal.base import Stage
from femseal.contact import PerfectlyPlastic
from femseal.store.store import Store


def module(text, name="laws_of_a_user"):
    """Return a module of a user, whose code is in no installed package."""
    made = types.ModuleType(name)
    exec(compile(text, f"{name}.py", "exec"), vars(made))
    return made


def hardening(text):
    """Return an object of a contact law of a user, whose slope [Pa/m] is in its code."""
    return module(
        "from dataclasses import dataclass\nimport numpy as np\n"
        "from femseal.contact.law import ContactLaw\n"
        "@dataclass(frozen=True, eq=False)\nclass Own(ContactLaw):\n    hardness: float\n"
        f"    def yield_pressure(self, u=0.0):\n        return self.hardness + {text} * np.asarray(u)\n"
        f"    def hardening_modulus(self, u=0.0):\n        return np.full(np.shape(u), {text})\n"
    ).Own(5e8)


def test_what_depends_on_a_law_of_a_user_is_not_stored(tmp_path):
    face = fs.self_affine((24, 24), (24e-6, 24e-6), hurst=0.8, rms_slope=0.2, rng=1)
    leakages = []
    for slope in ("0.0", "5e15"):
        scene = steel_scene(face, hardness=hardening(slope), loading=(2e8,))
        plain = fs.deterministic(scene).leakage
        for _ in range(2):
            with Store(tmp_path) as store:
                stored = fs.deterministic(scene, mapper=store.over(map)).leakage
            assert_allclose(stored, plain, rtol=1e-12)
        leakages.append(plain[0])
    assert abs(leakages[0] / leakages[1] - 1) > 1e-3


def test_a_stage_of_a_function_of_a_user_is_computed_each_time(tmp_path):
    def results(text):
        with Store(tmp_path) as store:
            stage = Stage("values", module(text).f)
            return list(store.over(map)(stage, [1, 2])), len(store)

    assert results("def f(x):\n    return x + 1") == ([2, 3], 0)
    assert results("def f(x):\n    return x + 2") == ([3, 4], 0)


def test_a_law_of_a_user_is_equal_to_itself_alone():
    law = hardening("0.0")
    assert law == law
    assert hash(law) == hash(law)
    assert law != hardening("0.0")
    assert law != hardening("5e15")
    assert PerfectlyPlastic(1e9) == PerfectlyPlastic(1e9) != PerfectlyPlastic(2e9)
