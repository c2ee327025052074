"""Loops are compiled ahead once, by parts, and these parts are all that a run needs."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from small_cases import SWEPT

from femseal.studies import compiling

#: Compiles the parts, then runs a case, and prints how many functions numba compiled for each.
COUNTS = """
import sys
from numba.core import event
import femseal
from femseal.studies import compiling
with event.install_recorder("numba:compile") as ahead:
    for part in compiling._PARTS:
        compiling._compile(part)
with event.install_recorder("numba:compile") as later:
    femseal.run(sys.argv[1], workers=1)
print(*(sum(e.is_start for _, e in recorder.buffer) for recorder in (ahead, later)))
"""


def test_loops_are_compiled_by_parts_and_once(tmp_path, monkeypatch):
    record = tmp_path / "compiled"
    monkeypatch.setattr(compiling, "_record", lambda parts: record)
    given, told = [], []

    def mapper(stage, parts):
        given.extend(parts)
        return parts

    for _ in range(2):
        compiling.compile_ahead(mapper, lambda *state: told.append(state[1:]))
    assert given == list(compiling._PARTS)
    assert told == [(k, len(given)) for k in range(len(given) + 1)]
    assert record.exists()


@pytest.fixture
def compiled_parts(tmp_path, monkeypatch):
    """List to which each call adds the parts to compile, and a mapper that adds them without compiling."""
    given = []

    def mapper(stage, parts):
        given.append(parts)
        return parts

    monkeypatch.setattr(compiling, "_record", lambda parts: tmp_path / f"compiled-{len(parts)}")
    return given, mapper


def test_loops_for_mirror_boundaries_are_only_compiled_if_they_are_needed(compiled_parts):
    given, mapper = compiled_parts
    for has_mirrors in (False, False, True):
        compiling.compile_ahead(mapper, has_mirrors=has_mirrors)
    without, with_mirrors = given  # the second call finds the record of the first
    assert set(with_mirrors) - set(without) == {"mirrors"}


def test_loops_for_threads_are_only_compiled_for_large_grids(compiled_parts):
    given, mapper = compiled_parts
    for points in (2**18 - 1, 2**18):
        compiling.compile_ahead(mapper, largest_grid=points)
    small, large = given
    assert set(large) - set(small) == {"threads"}


def test_processes_that_die_leave_no_record(tmp_path, monkeypatch):
    record = tmp_path / "compiled"
    monkeypatch.setattr(compiling, "_record", lambda parts: record)
    with pytest.raises(MemoryError):
        compiling.compile_ahead(
            lambda stage, parts: (_ for _ in ()).throw(MemoryError), lambda *state: None
        )
    assert not record.exists()


@pytest.mark.slow
def test_the_parts_hold_what_a_run_compiles(tmp_path):
    (tmp_path / "case.toml").write_text(SWEPT)
    (tmp_path / "cache").mkdir()
    env = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    said = subprocess.run(
        [sys.executable, "-c", COUNTS, tmp_path / "case.toml"],
        env=env,
        capture_output=True,
        text=True,
        check=True,
    )
    ahead, later = map(float, said.stdout.split())
    assert later < 0.1 * ahead


PLACES = """
import os
from pathlib import Path
os.environ.pop("NUMBA_CACHE_DIR", None)
writable = os.access
os.access = lambda path, mode: "femseal-" in str(path) and writable(path, mode)
import femseal
print(os.environ["NUMBA_CACHE_DIR"])
from femseal.flow.percolation import find
print(find.stats.cache_path)
"""


def test_where_nothing_can_be_written_loops_are_kept_in_a_temporary_folder():
    """Without one, numba refuses to import them."""
    said = subprocess.run(
        [sys.executable, "-c", PLACES], capture_output=True, text=True, check=True
    ).stdout.split()
    assert Path(said[1]).parent == Path(said[0])
    assert not Path(said[0]).exists()


LOOPS = """
from femseal.base.compiled import compiled

@compiled()
def total(pair):
    return pair.a + pair.b
"""
PAIR = """
from typing import NamedTuple

class Pair(NamedTuple):
    a: float
    b: float
"""
SUM = """
import os, sys
from pathlib import Path
import femseal
from femseal.base.lazy_package import choose_cache_folder
del os.environ["NUMBA_CACHE_DIR"]
choose_cache_folder(Path("package"))
sys.path.insert(0, ".")
from package import loops, {module}
print(loops.total({module}.Pair(1.0, 2.0)))
"""


def test_loops_that_a_former_installation_has_compiled_are_not_read(tmp_path):
    """They may name a class of a module that is gone."""
    package = tmp_path / "package"
    package.mkdir()
    (package / "loops.py").write_text(LOOPS)
    for module in ("former", "later"):
        (package / "former.py").unlink(missing_ok=True)
        (package / "__init__.py").write_text("")
        (package / f"{module}.py").write_text(PAIR)
        command = [sys.executable, "-B", "-c", SUM.format(module=module)]
        said = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
        assert said.stdout.split() == ["3.0"], said.stderr
