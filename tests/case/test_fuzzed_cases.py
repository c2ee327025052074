"""Fuzzed case files are checked or refused: no traceback, no wait, no large allocation, and a message that says why."""

import re
import resource
import signal
import sys
import warnings
from contextlib import contextmanager, suppress

import psutil
import pytest
from case_fuzz import CaseFuzz, spare_files

import femseal as fs
from femseal.named_fluids import names_in_coolprop
from femseal.preparation import memory as sizes
from femseal.preparation import prepare
from femseal.runs.forecast import refuse_too_large
from femseal.runs.run_description import describe

#: CPU time that checking a case may take [s], and memory that it may ask for [byte].
LONGEST, MOST = 2.0, 2e9
#: CPU time that the first case may take that needs a compiled function [s].
COMPILING = 60.0
#: A line of a refusal: key, what was given, what is allowed.
LINE = re.compile(r"\d+ more faults?|.+: (given .+, |missing, )?expected .+")
#: A table to paste, below a line that says so.
PASTED = re.compile(r"(?<=expected a table such as)(\n(\[.+\]|\w+ = .+))+")
#: What only a programmer understands.
INSIDE = re.compile(
    r"pydantic|Traceback|object at 0x|Error\b|numpy|<class|NoneType|Unable to allocate|\bValue error\b"
)


class TooLong(BaseException):
    """Checking took too long."""


@contextmanager
def limits(seconds):
    """Limit the CPU time and the memory of this process."""

    def late(*_):
        raise TooLong(f"not done after {seconds:g} s")

    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    before = signal.signal(signal.SIGVTALRM, late)
    signal.setitimer(signal.ITIMER_VIRTUAL, seconds)
    resource.setrlimit(resource.RLIMIT_AS, (int(psutil.Process().memory_info().vms + MOST), hard))
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0)
        signal.signal(signal.SIGVTALRM, before)
        resource.setrlimit(resource.RLIMIT_AS, (soft, hard))


def told(path):
    """What `femseal check` says of a case; an InputError is raised as it is."""
    case = fs.load_case(path)
    prepared = prepare(case)
    lines = describe(case, prepared)
    refuse_too_large(case, prepared)
    case.echo()
    return lines


def fault(path, seconds=LONGEST):
    """What is wrong with checking a case file, "" if nothing is; and whether it was refused."""
    try:
        with limits(seconds), warnings.catch_warnings():
            warnings.simplefilter("error", RuntimeWarning)
            told(path)
    except fs.InputError as error:
        lines = PASTED.sub(" …", str(error)).splitlines()
        wrong = [
            line
            for line in lines
            if not LINE.fullmatch(line) or INSIDE.search(line) or len(line) > 700
        ]
        wrong += [line for line in lines if not line.isprintable()]
        return "\n".join(wrong) if lines else "no message", True
    except (TooLong, Exception) as error:
        return f"{type(error).__name__}: {error}", False
    return "", False


@pytest.fixture(scope="module")
def fuzz(tmp_path_factory):
    """Fuzzed cases, and the file that they are written to."""
    folder = tmp_path_factory.mktemp("fuzzed")
    spare_files(folder)
    texts, path = CaseFuzz(), folder / "case.toml"
    path.write_bytes(texts.text(0))
    told(path)  # compiled loops and libraries are loaded once
    return texts, path


def check(fuzz, numbers):
    texts, path = fuzz
    refused = 0
    for number in numbers:
        path.write_bytes(texts.text(number))
        wrong, was_refused = fault(path)
        if wrong.startswith(TooLong.__name__):
            # functions may have been compiled: they are compiled now, and the case is checked again
            fault(path, COMPILING)
            wrong, was_refused = fault(path)
        assert not wrong, f"case {number}: {wrong}"
        refused += was_refused
    # neither all well nor all spoiled
    assert 0.3 * len(numbers) <= refused <= 0.97 * len(numbers)


@pytest.fixture(autouse=True)
def _little_memory(monkeypatch):
    """Faces of more than a million points are refused."""
    monkeypatch.setattr(sizes, "free_memory", lambda: 1e8)


def test_a_hundred_fuzzed_cases(fuzz, monkeypatch):
    monkeypatch.setitem(
        sys.modules, "CoolProp", None
    )  # reading all its fluids takes longer than all the cases
    check(fuzz, range(100))


@pytest.mark.slow
@pytest.mark.parametrize("first", range(1000, 101_000, 2000))
def test_a_hundred_thousand_fuzzed_cases(fuzz, first):
    with suppress(ImportError):
        # reads all fluids of CoolProp, which takes longer than a case may take
        names_in_coolprop()
    check(fuzz, range(first, first + 2000))


NEXT_TO_NOTHING = """
method = "deterministic"
face = {kind = "turned", points = [64, 128], size = ["240 um", "480 um"], pitch = "60 um", depth = "1.5 um",
        feed_error = 0.03, depth_error = 0.1, roughness = "1 um", roughness_roll_off = "40 um"}
material = {young = "210 GPa", poisson = 0.3, yield_stress = "1 GPa"}
fluid = {kind = "liquid", viscosity = "1 mPa*s", inlet_pressure = "10 MPa", outlet_pressure = "0.1 MPa"}
output = {pictures = false, budget = false}

[load]
loading = ["25 MPa", "50 MPa", "100 MPa", "200 MPa", "300 MPa", "450 MPa", "600 MPa", "900 MPa"]
unload_from = ["450 MPa", "900 MPa"]
unloading = ["1e-29 Pa", "300 MPa"]
""".replace(",\n        ", ", ")


def test_a_load_of_next_to_nothing_is_forecast(fuzz):
    """Coarser grids of a smooth face find no point near contact under 1e-29 Pa."""
    _, path = fuzz
    path.write_text(NEXT_TO_NOTHING, encoding="utf-8")
    assert fault(path) == ("", False)
