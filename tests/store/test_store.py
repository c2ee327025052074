"""A store: what is kept is found again by all that goes into it, and by nothing else, however a process ends."""

import errno
import hashlib
import os
import random
import re
import subprocess
import sys
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from kept_study import EVERY, Crash, assert_complete, resumed, study, value

import femseal as fs
from femseal.base import Stage, numerical_versions
from femseal.face.cell_flow import SolveCounts
from femseal.store import store
from femseal.store.digests import NoDigest, digest
from femseal.store.store import SUFFIX, Store

EXAMPLES = Path(__file__).parents[2] / "examples"


@pytest.mark.parametrize("seed", range(5))
def test_a_study_that_is_killed_again_and_again_computes_nothing_twice(tmp_path, monkeypatch, seed):
    rng, computed = random.Random(seed), []
    monkeypatch.setattr(Store, "__exit__", lambda *a: None)  # as a kill leaves it
    crashes, results = 0, None
    while results is None:
        left = rng.randint(1, 9)

        def crashing(function, *iterables):
            for item in map(function, *iterables):
                yield item
                nonlocal left
                left -= 1
                if left == 0:
                    raise Crash

        try:
            results = study(Store(tmp_path).over(crashing), computed)
        except Crash:
            crashes += 1
    assert crashes > 1
    assert_complete(results)
    assert sorted(computed) == EVERY


def test_a_process_that_exits_at_once_leaves_its_results(tmp_path):
    code = (
        "import os, sys; sys.path.insert(0, sys.argv[1]); from pathlib import Path\n"
        "from kept_study import *\n"
        "def ending(function, *iterables):\n"
        "    for n, item in enumerate(map(function, *iterables)):\n"
        "        if n == 18: os._exit(9)\n"
        "        yield item\n"
        "resumed(Path(sys.argv[2]), ending)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, str(Path(__file__).parents[1]), str(tmp_path)]
    )
    assert done.returncode == 9
    results, computed = resumed(tmp_path)
    assert_complete(results)
    assert computed == [(3, 18), (3, 19)]


def test_a_record_that_a_kill_cut_is_computed_again_and_the_others_are_not(tmp_path, caplog):
    resumed(tmp_path)
    (path,) = tmp_path.glob(f"*{SUFFIX}")
    os.truncate(path, path.stat().st_size - 1)
    results, computed = resumed(tmp_path)
    assert_complete(results)
    assert computed == [(3, 19)]
    assert "damaged" not in caplog.text
    assert resumed(tmp_path)[1] == []


def ahead(function, *iterables):
    """A map that takes all its items before it gives a result."""
    return iter(list(map(function, *iterables)))


@pytest.mark.parametrize("at", [0.0, 0.3, 0.5, 0.99])
def test_a_flipped_bit_costs_results_and_changes_none(tmp_path, caplog, at):
    """In the size of a record it costs those behind it too; in its data it is said."""
    resumed(tmp_path)
    (path,) = tmp_path.glob(f"*{SUFFIX}")
    data = bytearray(path.read_bytes())
    data[int(at * len(data))] ^= 1
    path.write_bytes(data)
    results, computed = resumed(tmp_path)
    assert_complete(results)
    assert computed
    if at == 0.99:
        assert f"{path}: a result is damaged" in caplog.text
    assert resumed(tmp_path)[1] == []


def test_a_result_is_found_by_the_function_and_every_input(tmp_path):
    """And by nothing else: neither the name of the stage, nor its place among others."""
    calls = []

    def keeping(function, *iterables):
        calls.append([item for (item,) in zip(*iterables, strict=True)])
        return (function(item) for item in calls[-1])

    def asked(stage, *items):
        calls.clear()
        with Store(tmp_path) as kept:
            results = list(kept.over(keeping)(stage, *items))
        return results, [item for call in calls for item in call]

    power = Stage("powers", partial(np.power, 2.0))
    exponents = np.arange(3.0)
    first, computed = asked(power, exponents)
    assert computed == [0.0, 1.0, 2.0]
    assert asked(Stage("another name", partial(np.power, 2.0)), exponents[::-1]) == (
        first[::-1],
        [],
    )
    assert asked(Stage("powers", partial(np.power, 3.0)), exponents)[1] == computed
    assert asked(Stage("powers", partial(np.multiply, 2.0)), exponents)[1] == computed
    assert asked(power, exponents.astype(np.float32))[1] == computed
    assert asked(power, [1, np.float64(2.0)])[1] == [1]


def test_other_versions_find_nothing(tmp_path, monkeypatch):
    resumed(tmp_path)
    monkeypatch.setattr(
        store, "numerical_versions", lambda: {**numerical_versions(), "CoolProp": "9.9"}
    )
    assert resumed(tmp_path)[1] == EVERY
    assert "CoolProp" in numerical_versions()


@pytest.mark.parametrize("mapper", [map, ahead])
def test_equal_items_are_computed_once(tmp_path, mapper):
    computed = []
    stage = Stage("values", partial(value, 0, computed=computed), key="values")
    items = [1, 2, 1, 1, 2, 3]
    with Store(tmp_path) as kept:
        results = list(kept.over(mapper)(stage, items, items))
    np.testing.assert_equal(results, [value(0, item, item) for item in items])
    assert [item for _, item in computed] == [1, 2, 3]


def test_what_has_no_digest_or_is_no_data_is_computed_and_not_kept(tmp_path):
    with Store(tmp_path / "out") as kept:
        mapper = kept.over(map)
        assert list(mapper(Stage("bound", "-".join), [["a", "b"]])) == ["a-b"]
        assert list(mapper(Stage("types", type), [1, 1, "a"])) == [int, int, str]
        assert list(mapper(Stage("lengths", len), [range(2), (1,)])) == [2, 1]
        assert len(kept) == 1


def test_values_are_told_apart_by_type_shape_order_and_every_bit(tmp_path):
    field = np.arange(6.0).reshape(2, 3)
    variants = [field, field.T, field.ravel(), field.astype(np.float32), np.asfortranarray(field)]
    variants += [np.nextafter(field, 9), (field,), [field], {"field": field}]
    variants += [field.tolist(), field.tobytes(), 0, 0.0, -0.0, False, None, "", b"", "0"]
    variants += [SolveCounts(), SolveCounts(solved=1), SolveCounts(closed=1)]
    assert len({digest(value) for value in variants}) == len(variants)
    assert digest(field) == digest(field.copy())
    one, other = tmp_path / "one", tmp_path / "other"
    for path in (one, other):
        path.write_text("a")
    assert digest(one) == digest(other) != digest(str(one))
    other.write_text("b")
    assert digest(one) != digest(other)
    # functions of classes have names, those of objects of C code have not
    assert len({*map(digest, (SolveCounts.of, SolveCounts.total))}) == 2
    for nameless in ("".join, tmp_path / "missing"):
        with pytest.raises(NoDigest):
            digest(nameless)


def test_every_file_of_the_source_is_part_of_the_version():
    source = hashlib.sha256()
    for path in sorted(Path(fs.__file__).parent.rglob("*.py")):
        source.update(path.read_bytes())
    assert numerical_versions()["femseal"].endswith(f"+{source.hexdigest()[:12]}")


@pytest.mark.parametrize("room", [0, 30, 500])
def test_a_full_disk_loses_nothing_that_is_written(tmp_path, room):
    """The disk is full within a record, of which nothing stays."""
    code = (
        "import resource, signal, sys; sys.path.insert(0, sys.argv[1]); from pathlib import Path\n"
        "from kept_study import *\n"
        "signal.signal(signal.SIGXFSZ, signal.SIG_IGN)\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[3]),) * 2)\n"
        "resumed(Path(sys.argv[2]))\n"
    )
    given = map(str, (Path(__file__).parents[1], tmp_path, 2000 + room))
    done = subprocess.run([sys.executable, "-c", code, *given], capture_output=True, text=True)
    assert re.search("results are kept.*--resume", done.stderr), done.stderr
    with Store(tmp_path) as kept:
        there = len(kept)
    assert there > 5
    results, computed = resumed(tmp_path)
    assert_complete(results)
    assert len(computed) == len(EVERY) - there


def test_a_store_that_nobody_needs_does_without_a_disk(tmp_path, monkeypatch, caplog):
    def full(*parts):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(Store, "_append", full)
    with Store(tmp_path, required=False) as kept:
        assert_complete(study(kept.over(map)))
    assert caplog.text.count("results are not kept any more") == 1


def test_two_processes_share_a_store(tmp_path):
    """Each appends to a file of its own, and finds what the other has added when it looks."""
    stage = Stage("values", partial(value, 0), key="values")
    with Store(tmp_path) as one, Store(tmp_path) as two:
        list(one.over(map)(stage, range(4), range(4)))
        assert len(two) == 0
        two.look()
        assert len(two) == 4
        list(two.over(map)(stage, range(6), range(6)))
        one.look()
        assert len(one) == 6
    assert len(list(tmp_path.iterdir())) == 2


@pytest.mark.parametrize(
    "name", [pytest.param("gasket_seal", marks=pytest.mark.slow), "wanted_accuracy"]
)
def test_every_stage_of_a_run_is_kept(tmp_path, monkeypatch, name):
    """Else a run that goes on would compute it again."""
    left = []
    of_stage, of_item, keep = Store.keys, store._key, Store._write

    def keys(self, stage):
        try:
            return of_stage(self, stage)
        except NoDigest:
            left.append(stage.name)
            raise

    def key(base, item):
        left.extend([] if (found := of_item(base, item)) else [item])
        return found

    def keeping(self, key, result):
        keep(self, key, result)
        left.extend([] if key in self._records else [type(result)])

    monkeypatch.setattr(Store, "keys", keys)
    monkeypatch.setattr(store, "_key", key)
    monkeypatch.setattr(Store, "_write", keeping)
    case = fs.load_case(EXAMPLES / f"{name}.toml")
    changed = {"output": {"pictures": False, "report": False, "paraview": "none"}}
    if name == "gasket_seal":
        changed["output"]["budget"] = False
        changed["stochastic"] = {"realisations": 2}
    small = {key: getattr(case, key).model_copy(update=values) for key, values in changed.items()}
    fs.run(case.model_copy(update=small), tmp_path / "out", workers=1)
    assert not left
