"""Digests of functions and values, and what has none."""

import subprocess
import sys
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from laws_of_users import law_of_user

import femseal as fs
from femseal.contact import LinearHardening, PerfectlyPlastic
from femseal.loads import LoadProgramme
from femseal.store.digests import NoDigest, digest
from femseal.studies.face_study import FaceState


@dataclass(frozen=True)
class Fluid:
    viscosity: float


class Plain:
    def __call__(self, x):
        return x


@pytest.mark.parametrize(
    "value",
    [
        law_of_user("0.0"),
        type(law_of_user("0.0")),
        law_of_user("0.0").yield_pressure,
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
