"""The hard scenes give what they must; judges take nothing else."""

import numpy as np
import pytest
from hard_scene import HardScene
from judges import between, exactly, falling, near, refused, zero_and_positive
from report import SCENES, main

from femseal import InputError, NotConverged


@pytest.mark.parametrize(
    "scene",
    [pytest.param(s, id=s.name, marks=[pytest.mark.slow] if s.slow else []) for s in SCENES],
)
def test_scene(scene):
    within, came = scene.outcome()
    assert within, f"must: {scene.must.text}, came: {came}"
    size = np.size(came)
    for other in (np.full(size, np.nan), (), MemoryError("all gone")):
        assert not scene.must.holds(other)


@pytest.mark.parametrize(
    ("judge", "right", "wrong"),
    [
        (near((1.0, 2.0), 1e-3), (1.0009, 2.0), ((1.0011, 2.0), (1.0, 1.997), 1.0, (1.0,) * 3)),
        (exactly(2.0), 2.0, (np.nextafter(2.0, 3), -2.0)),
        (between(0.0, np.inf, ""), (0.0, 5.0), (np.inf, -1e-300)),
        (falling(""), (2.0, 1.0), ((1.0, 1.0), (1.0, 2.0), 1.0, (1.0, -np.inf))),
        (falling("", steeply=False), (1.0, 1.0), ((1.0, 2.0), 1.0)),
        (zero_and_positive(""), (0.0, 1e-300), ((0.0, 0.0), (1e-300, 1.0), 0.0, (0.0, np.inf))),
        (refused("gap"), InputError("gap", "-1", "more"), (ValueError("gap"), NotConverged("gap"))),
    ],
)
def test_judges(judge, right, wrong):
    assert judge.holds(right)
    assert not any(judge.holds(came) for came in wrong)


def test_what_falls_short_is_reported(capsys):
    scenes = [
        HardScene("flow", "made up", "", near(1.0, 1e-3), run)
        for run in (lambda: 1.0, lambda: 2.0, lambda: 1 / 0)
    ]
    assert main(scenes=scenes) == 1
    assert "3 scenes, 2 short" in capsys.readouterr().out
    assert main("flow: no such scene") == 1
    assert main(scenes=scenes[:1]) == 0
