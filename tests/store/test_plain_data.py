"""Plain data are stored as bytes and restored exactly; other bytes are refused."""

import json
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from femseal.face.cell_flow import CellPermeabilities, Failed, SolveCounts
from femseal.store.digests import digest
from femseal.store.plain_data import packed, unpacked

COUNTS = SolveCounts((("amg", 1),), 1e-300, solved=2)


VALUE = {
    "plain": (None, True, -(10**30), 1 / 3, -0.0, float("inf"), "µ\ud800", b"\x00\xff", [], ()),
    (1, "key"): [np.float64(0.1), np.float32(np.pi), np.int64(-3), np.bool_(True), np.array(2.5)],
    "arrays": (
        np.arange(12.0).reshape(3, 4),
        np.asfortranarray(np.arange(12, dtype=np.float32).reshape(3, 4)),
        np.zeros((0, 3)),
        np.array([True, False]),
        np.array([np.nan, -np.nan, 1e-310]),
    ),
    "classes": (CellPermeabilities(np.array([1e-18, np.nan]), COUNTS), Failed("because")),
}


def test_stored_values_are_restored_exactly():
    """As the digest tells values apart: by type, shape, order and every bit."""
    back = unpacked(packed(VALUE))
    assert digest(back) == digest(VALUE)
    back["arrays"][0][0] = 1.0  # arrays can be written to
    turned = np.arange(24).reshape(2, 3, 4).transpose(1, 0, 2)[:, ::-1]
    np.testing.assert_array_equal(unpacked(packed(turned)), turned)


@dataclass
class Foreign:
    x: int = 1


@pytest.mark.parametrize(
    "value", [Foreign(), object(), print, np.array([None]), np.array(["a"]), {1}, Path("/")]
)
def test_only_plain_data_are_stored(value):
    with pytest.raises(TypeError, match="not plain data"):
        packed((1, value))


def text_of(tree, content=b""):
    text = tree if isinstance(tree, bytes) else json.dumps(tree).encode()
    return len(text).to_bytes(8, "little") + text + content


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"\xff" * 20,
        text_of(b"[" * 100_000),
        text_of({"a": 1}),
        text_of([]),
        text_of(["os.system", "true"]),
        text_of(["subprocess.Popen", ["list", "true"]]),
        text_of(["femseal.runs.job.run", "case.toml"]),
        text_of(["femseal.runs.job.Path", "x"]),
        text_of(["femseal.case.case.Case"]),
        text_of(["femseal.face.cell_flow.Failed"]),
        text_of(["femseal.face.cell_flow.Failed", "a", "b"]),
        text_of(["femseal.no_such_room.Failed", "a"]),
        text_of([1, 2]),
        text_of(["array", "<f8", [10**12], "C", 0], b"12345678"),
        text_of(["array", "<f8", [-1, -1], "C", 0], b"12345678"),
        text_of(["array", "<f8", [0, 10**30], "C", 0]),
        text_of(["array", "|O", [1], "C", 0], b"12345678"),
        text_of(["array", "(1000000000,)f8", [1], "C", 0], b"12345678"),
        text_of(["array", "<f8", [1], "C", 8], b"12345678"),
        text_of(["array", "<f8", [1], "C", -8], b"12345678"),
        text_of(["array", "<f8", [1.0], "X", 0], b"12345678"),
        text_of(["array", "<f8", "11", "C", 0], b"12345678"),
        text_of(["bytes", 10**12, 0], b"1"),
        text_of(["dict", ["a"]]),
        text_of(["dict", [["list"], 1]]),
    ],
    ids=range(26),
)
def test_bytes_that_are_no_values_are_refused(data):
    with pytest.raises(ValueError):
        unpacked(data)


WHOLE = packed(VALUE)


@given(st.integers(0, len(WHOLE) - 1), st.binary(max_size=3), st.integers(0, 3))
def test_damaged_bytes_give_a_value_or_a_value_error(at, new, lost):
    with suppress(ValueError):
        unpacked(WHOLE[:at] + new + WHOLE[at + lost :])
