"""Errors keep their class and their attributes in copies, in pickles and on the way from a worker process."""

import copy
import pickle
import threading
from pathlib import Path

import pytest

from femseal.base import Stage
from femseal.base.errors import MISSING, FileError, InputError, InputErrors, NotConverged, NotKept
from femseal.base.quantities import OtherKind, to_si
from femseal.execution.run import ordered_map
from femseal.topography.defects import TooManyUndefined


class WithNumber(InputError):
    """Has a constructor of its own, and an attribute that no other error has."""

    def __init__(self, number):
        self.number = number
        super().__init__("wave", 1.0, "{shape}", {"shape": (4, 8)})


ERRORS = [
    InputError("wave", 1.0, "2, or {shape}", {"shape": (4, 8)}),
    TooManyUndefined("wave", 1.0, "2, or {shape}", {"shape": (4, 8)}),
    OtherKind("wave", 1.0, "a length"),
    FileError(Path("face.plu"), "wave", 1.0, "a file"),
    InputErrors([FileError(Path("a"), "wave", 1.0, "b"), OtherKind("shape", 3, "c")]),
    WithNumber(7),
]


def by_pickle(error):
    return pickle.loads(pickle.dumps(error))


def attributes(error):
    """Attributes of an error, and those of the errors that it contains."""
    found = {name: value for name, value in vars(error).items() if name != "faults"}
    faults = [attributes(fault) for fault in getattr(error, "faults", ())]
    # a value that was given is repeated as text
    return type(error), found | {"given": str(error.given)}, faults


def test_every_class_of_the_package_is_tested():
    classes = [InputError]
    for kind in classes:
        classes += kind.__subclasses__()
    of_package = {kind for kind in classes if kind.__module__.startswith("femseal.")}
    assert of_package <= {type(error) for error in ERRORS}


@pytest.mark.parametrize("duplicate", [by_pickle, copy.copy])
@pytest.mark.parametrize("error", ERRORS, ids=lambda error: type(error).__name__)
def test_a_copy_has_the_same_class_text_and_attributes(error, duplicate):
    again = duplicate(error)
    assert attributes(again) == attributes(error)
    assert str(again) == str(error)
    in_case = again.with_keys({"shape": "face.points"}).inside("load")
    assert str(in_case) == str(error.with_keys({"shape": "face.points"}).inside("load"))


@pytest.mark.parametrize("error", ERRORS, ids=lambda error: type(error).__name__)
def test_an_error_with_keys_of_a_case_has_the_same_class_and_attributes(error):
    in_case = error.with_keys({"wave": "shortest_wave", "shape": "points"}).inside("face")
    assert type(in_case) is type(error)
    assert in_case.what == "face.shortest_wave"
    assert in_case.given == error.given
    same = set(vars(error)) - {"what", "expected", "_template", "suggested", "faults"}
    assert all(getattr(in_case, name) == getattr(error, name) for name in same)
    assert "shape=" not in str(in_case)
    # the first error is as it was
    assert error.what == "wave"


def test_all_faults_get_the_keys_of_a_case():
    error = InputErrors([InputError("wave", 1, "2"), InputError("shape", 3, "4")])
    in_case = error.with_keys({"wave": "shortest_wave", "shape": "points"}).inside("face")
    assert str(in_case).splitlines() == [
        "face.shortest_wave: given 1, expected 2",
        "face.points: given 3, expected 4",
    ]
    assert in_case.what == "face.shortest_wave"


def test_a_given_object_that_cannot_be_pickled_is_repeated_as_text():
    lock = threading.Lock()
    again = by_pickle(TooManyUndefined("mapper", lock, "a function"))
    assert type(again) is TooManyUndefined
    assert again.given == str(lock)


def test_an_absent_input_is_not_the_text_missing():
    absent, text = InputError("name", MISSING, "a name"), InputError("name", "missing", "a number")
    for error in (absent, by_pickle(absent), copy.copy(absent)):
        assert error.given is MISSING
        assert str(error) == "name: missing, expected a name"
    for error in (text, by_pickle(text)):
        assert str(error) == "name: given missing, expected a number"


def test_notes_are_kept():
    error = OtherKind("wave", 1.0, "a length")
    error.add_note("in face.plu")
    assert by_pickle(error).__notes__ == error.inside("face").__notes__ == ["in face.plu"]


def test_other_errors_keep_their_attributes():
    again = by_pickle(NotConverged("no solution", 0.5))
    assert (type(again), str(again), again.residual) == (NotConverged, "no solution", 0.5)
    assert type(by_pickle(NotKept("disk is full"))) is NotKept


def test_an_error_of_a_worker_process_has_its_class():
    with (
        ordered_map(workers=2) as mapping,
        pytest.raises(OtherKind, match="wave: given None") as caught,
    ):
        list(mapping(Stage("trial", to_si), [None], ["m"], ["wave"]))
    assert caught.value.what == "wave"
