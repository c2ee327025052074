"""What depends on code of users is not stored."""

from laws_of_users import law_of_user, module_of_user
from numpy.testing import assert_allclose
from small_cases import steel_scene

import femseal as fs
from femseal.base import Stage
from femseal.contact import PerfectlyPlastic
from femseal.store.store import Store


def test_what_depends_on_a_law_of_a_user_is_not_stored(tmp_path):
    face = fs.self_affine((24, 24), (24e-6, 24e-6), hurst=0.8, rms_slope=0.2, rng=1)
    leakages = []
    for slope in ("0.0", "5e15"):
        scene = steel_scene(face, hardness=law_of_user(slope), loading=(2e8,))
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
            stage = Stage("values", module_of_user(text).f)
            return list(store.over(map)(stage, [1, 2])), len(store)

    assert results("def f(x):\n    return x + 1") == ([2, 3], 0)
    assert results("def f(x):\n    return x + 2") == ([3, 4], 0)


def test_a_law_of_a_user_is_equal_to_itself_alone():
    law = law_of_user("0.0")
    assert law == law
    assert hash(law) == hash(law)
    assert law != law_of_user("0.0")
    assert law != law_of_user("5e15")
    assert PerfectlyPlastic(1e9) == PerfectlyPlastic(1e9) != PerfectlyPlastic(2e9)
