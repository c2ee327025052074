"""Digests of functions, classes and objects of users: they change with what the code does, and with nothing else."""

import subprocess
import sys
import types
from dataclasses import dataclass
from functools import cached_property, lru_cache, partial
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from small_cases import steel_scene

import femseal as fs
from femseal.base import Stage
from femseal.store.code import NoDigest
from femseal.store.digests import digest
from femseal.store.store import Store


def module(text, name="laws_of_a_user", **values):
    """A module of a user, whose code is in no installed package."""
    made = types.ModuleType(name)
    vars(made).update(values)
    exec(compile(text, f"{name}.py", "exec"), vars(made))
    return made


LAW = """
from abc import ABC
from dataclasses import dataclass
import numpy as np
from femseal.contact.law import ContactLaw
STIFF = 1.5
def helper(u):
    return STIFF * u
@dataclass(frozen=True, eq=False)
class Base(ContactLaw):
    hardness: float
    def scaled(self, u):
        return 2.0 * helper(u)
@dataclass(frozen=True, eq=False)
class Law(Base):
    def yield_pressure(self, u, power=1.0):
        return self.hardness * (1 + self.scaled(np.abs(u)) ** power)
    def hardening_modulus(self, u):
        return np.gradient(u)
    def curve(self, least):
        return lambda u: max(u, least)
"""
#: Changes of the text that change what an object of the law does.
CHANGES = {
    "a global number": ("STIFF = 1.5", "STIFF = 1.6"),
    "a helper": ("return STIFF * u", "return STIFF + u"),
    "a constant in a base class": ("2.0 * helper", "3.0 * helper"),
    "a default value": ("power=1.0", "power=2.0"),
    "an operator": ("(1 + self", "(1 - self"),
    "a function of a library": ("np.abs(u)", "np.exp(u)"),
    "another library": ("import numpy as np", "import scipy.special as np"),
    "another method": ("np.gradient", "np.diff"),
    "a lambda": ("max(u, least)", "min(u, least)"),
    "a base class": ("class Law(Base)", "class Law(Base, ABC)"),
}


@pytest.mark.parametrize("change", CHANGES)
def test_a_law_with_other_code_has_another_digest(change):
    old, new = CHANGES[change]
    assert old in LAW
    first, same, other = (module(t) for t in (LAW, "\n\n" + LAW, LAW.replace(old, new)))
    for value in (
        lambda made: made.Law,
        lambda made: partial(made.Law, 1e9),
        lambda made: made.Law(1e9),
        lambda made: made.Law(1e9).yield_pressure,
        lambda made: {"scene": [1.0, partial(np.add, made.Law(1e9))]},
    ):
        assert digest(value(first)) == digest(value(same)) != digest(value(other))


def test_a_law_with_other_parameters_has_another_digest():
    law = module(LAW).Law
    assert digest(law(1e9)) == digest(law(1e9)) != digest(law(2e9))


def test_values_of_enclosing_functions_count():
    def law(limit, scale=2.0):
        def factor(gap):
            return np.minimum(scale * gap, limit)

        return factor

    assert digest(law(1.0)) == digest(law(1.0))
    assert len({digest(law(1.0)), digest(law(2.0)), digest(law(1.0, 3.0))}) == 3
    assert digest(lambda x: x + 1) == digest(lambda x: x + 1) != digest(lambda x: x + 2)
    table = np.arange(3.0)
    assert digest(law(table)) == digest(law(table.copy())) != digest(law(table + 1))


def test_values_of_other_modules_of_the_user_count(monkeypatch):
    def law(text):
        helpers = module(text, "helpers_of_a_user")
        return module("def law(u):\n    return helpers.curve(u)", helpers=helpers).law

    curve = "SLOPE = {}\ndef curve(u):\n    return SLOPE * u\ndef other(u):\n    return {}"
    first = law(curve.format(1, 1))
    assert digest(first) == digest(law(curve.format(1, 2))) != digest(law(curve.format(2, 1)))
    # a value that is changed while the program runs
    before = digest(first)
    first.__globals__["helpers"].SLOPE = 3
    assert digest(first) != before


def test_compiled_and_cached_functions_are_what_they_compile():
    import numba

    def compiled(text, **options):
        return numba.njit(**options)(module(text).f)

    text = "def f(x):\n    return x + 1"
    assert digest(compiled(text)) == digest(compiled(text)) != digest(compiled(text + "0"))
    assert digest(compiled(text)) != digest(compiled(text, fastmath=True))
    cached = [lru_cache(module(t).f) for t in (text, text, text + "0")]
    assert digest(cached[0]) == digest(cached[1]) != digest(cached[2])


@dataclass(frozen=True)
class Fluid:
    viscosity: float

    @cached_property
    def table(self):
        return object()

    def recursive(self, n):
        return self.recursive(n - 1) if n else type(self)


def test_cached_results_of_an_object_do_not_count_and_other_values_do():
    fluid = Fluid(1.0)
    before = digest(fluid)
    assert fluid.table
    assert digest(fluid) == before
    object.__setattr__(fluid, "hidden", 1.0)
    with_hidden = digest(fluid)
    object.__setattr__(fluid, "hidden", 2.0)
    assert len({before, with_hidden, digest(fluid)}) == 3


class Plain:
    def __call__(self, x):
        return x


@pytest.mark.parametrize(
    "value",
    [
        Plain(),
        Plain().__call__,
        np.random.default_rng(1),
        np.vectorize(lambda x: x),
        np.frompyfunc(lambda x: x, 1, 1),
        "".join,
        iter([1]),
        partial(Plain(), 1),
    ],
    ids=[
        "object",
        "method of an object",
        "generator",
        "numpy.vectorize",
        "ufunc of a lambda",
        "method of a string",
        "iterator",
        "partial of an object",
    ],
)
def test_what_cannot_be_described_has_no_digest(value):
    for one in (value, lambda: value, {"within": [value]}):
        with pytest.raises(NoDigest):
            digest(one)


def test_functions_of_libraries_are_known_by_their_names():
    known = [
        np.exp,
        np.log,
        np.linalg.norm,
        dict.fromkeys,
        str.join,
        len,
        fs.deterministic,
        fs.Scene,
    ]
    assert len({digest(value) for value in known}) == len(known)
    assert digest(np.exp) == digest(np.exp)


def test_a_digest_is_the_same_in_another_process(tmp_path):
    """Whatever order sets have there, and wherever the file lies."""
    code = (
        "import sys; sys.path.insert(0, sys.argv[1])\n"
        "import laws_in_a_file as laws\n"
        "from femseal.store.digests import digest\n"
        "print(digest(laws.Law(1e9)), digest(laws.CHOICE))"
    )
    found = set()
    for folder, seed in (("one", "1"), ("other", "2")):
        (tmp_path / folder).mkdir()
        choice = "CHOICE = lambda x: x in {'b', 'c', 'a'} or STIFF\n"
        (tmp_path / folder / "laws_in_a_file.py").write_text(LAW + choice)
        environment = {"PYTHONHASHSEED": seed, "PYTHONPATH": str(Path(fs.__file__).parents[1])}
        done = subprocess.run(
            [sys.executable, "-c", code, str(tmp_path / folder)],
            capture_output=True,
            text=True,
            check=True,
            env=environment,
        )
        found.add(done.stdout)
    assert len(found) == 1


def hardening(text):
    return module(
        "from dataclasses import dataclass\nimport numpy as np\n"
        "from femseal.contact.law import ContactLaw\n"
        "@dataclass(frozen=True, eq=False)\nclass Own(ContactLaw):\n    hardness: float\n"
        f"    def yield_pressure(self, u=0.0):\n        return self.hardness + {text} * np.asarray(u)\n"
        f"    def hardening_modulus(self, u=0.0):\n        return np.full(np.shape(u), {text})\n"
    ).Own(5e8)


def test_two_laws_of_one_name_do_not_share_a_stored_result(tmp_path):
    face = fs.self_affine((24, 24), (24e-6, 24e-6), hurst=0.8, rms_slope=0.2, rng=1)
    leakages = {}
    for slope in ("0.0", "5e15"):
        scene = steel_scene(face, hardness=hardening(slope), loading=(2e8,))
        plain = fs.deterministic(scene).leakage
        with Store(tmp_path) as store:
            leakages[slope] = fs.deterministic(scene, mapper=store.over(map)).leakage
        assert_allclose(leakages[slope], plain, rtol=1e-12)
        with Store(tmp_path) as store:
            there = len(store)
            fs.deterministic(scene, mapper=store.over(map))
            assert len(store) == there > 0
    assert hardening("0.0") == hardening("0.0") != hardening("5e15")
    assert abs(leakages["0.0"][0] / leakages["5e15"][0] - 1) > 1e-3


def test_a_law_without_a_digest_is_equal_to_itself_alone():
    law = module(LAW).Law
    assert law(Plain()) != law(Plain())
    one = law(Plain())
    assert one == one
    assert hash(one) == hash(one)


def test_a_stage_of_a_users_function_is_kept_by_its_code(tmp_path):
    def asked(text):
        with Store(tmp_path) as store:
            return list(store.over(map)(Stage("values", module(text).f), [1, 2]))

    assert asked("def f(x):\n    return x + 1") == [2, 3]
    assert asked("def f(x):\n    return x + 2") == [3, 4]
