"""Digests of functions, classes and objects: those of known packages have one, those of users have none."""

import subprocess
import sys
import types
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from small_cases import steel_scene

import femseal as fs
from femseal.base import Stage
from femseal.contact import LinearHardening, PerfectlyPlastic
from femseal.loads import LoadProgramme
from femseal.store.digests import NoDigest, digest
from femseal.store.store import Store
from femseal.studies.face_study import FaceState


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


@dataclass(frozen=True)
class Fluid:
    viscosity: float


class Plain:
    def __call__(self, x):
        return x


@pytest.mark.parametrize(
    "value",
    [
        hardening("0.0"),
        type(hardening("0.0")),
        hardening("0.0").yield_pressure,
        Fluid(1.0),
        Fluid,
        lambda x: x,
        Plain(),
        Plain().__call__,
        np.random.default_rng(1),
        np.vectorize(lambda x: x),
        np.frompyfunc(lambda x: x, 1, 1),
        "".join,
        iter([1]),
    ],
)
def test_the_code_of_users_and_objects_of_c_code_have_no_digest(value):
    for wrapped in (value, {"within": [value]}, partial(len, value)):
        with pytest.raises(NoDigest):
            digest(wrapped)


def test_functions_classes_and_objects_of_packages_are_known_by_their_names_and_values():
    known = [
        np.linalg.norm,
        len,
        fs.deterministic,
        fs.Scene,
        FaceState.of,
        PerfectlyPlastic(1e9),
        PerfectlyPlastic(2e9),
        LinearHardening(1e9, 0.0),
        PerfectlyPlastic(1e9).yield_pressure,
        partial(np.linalg.norm, ord=1),
        partial(np.linalg.norm, ord=2),
        LoadProgramme.of(loading=(1e8,)),
        tuple(LoadProgramme.of(loading=(1e8,))),
    ]
    assert len({digest(value) for value in known}) == len(known)
    assert digest(PerfectlyPlastic(1e9)) == digest(PerfectlyPlastic(1e9))
    assert digest(partial(np.linalg.norm, ord=1)) == digest(partial(np.linalg.norm, ord=1))


def test_a_digest_is_the_same_in_another_process():
    code = (
        "from functools import partial\n"
        "from femseal.contact import LinearHardening\n"
        "from femseal.store.digests import digest\n"
        "print(digest({'law': partial(LinearHardening, 1e9), 'b': (1.0, 'a')}))"
    )
    digests = set()
    for seed in ("1", "2"):
        environment = {"PYTHONHASHSEED": seed, "PYTHONPATH": str(Path(fs.__file__).parents[1])}
        process = subprocess.run(
            [sys.executable, "-c", code],
            capture_output=True,
            text=True,
            check=True,
            env=environment,
        )
        digests.add(process.stdout)
    assert len(digests) == 1


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
