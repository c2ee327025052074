"""A study of four stages of cheap items, for tests of what is kept of stages."""

from functools import partial

import numpy as np

from femseal.base import Stage
from femseal.store.store import Store

#: Number of items of each stage, and every item with its stage.
SIZES = (7, 1, 0, 20)
EVERY = [(stage, item) for stage, size in enumerate(SIZES) for item in range(size)]


def value(stage, item, extra, computed=None):
    if computed is not None:
        computed.append((stage, item))
    return {"field": np.sin(np.arange(4.0) + item), "name": (stage, item, extra)}


def study(mapper, computed=None):
    """Calls of the map as a study makes them, with lazy arguments."""
    results = []
    for n, size in enumerate(SIZES):
        # the list of what was computed is no input
        stage = Stage(f"stage {n}", partial(value, n, computed=computed), key=("value", n))
        results += mapper(
            stage, (item for item in range(size)), [str(item) for item in range(size)]
        )
    return results


def resumed(folder, mapper=map):
    """Results of the study with a store, and what was computed of them."""
    computed = []
    with Store(folder) as kept:
        return study(kept.over(mapper), computed), computed


def assert_complete(results):
    np.testing.assert_equal(results, study(map))


class Crash(BaseException):
    pass
