"""Define the decorators that compile the loops of the contact solver.

A loop processes the points `first` to `end` − 1 of a list. If Python calls the decorated loop, several threads share
the work. If compiled code calls it, the loop runs once for all points, see `base.compiled`.
"""

from typing import Any

from ..base.compiled import by_items, compiled, leader, summed

#: Options of loops whose sums keep their order. All functions are inlined. A function that is called may be compiled
#: differently in another process, which would change the last digits of results.
EXACT: dict[str, Any] = {"forceinline": True}
#: As `EXACT`, but sums may be reordered for vector instructions. The arrays must not contain NaN.
FAST: dict[str, Any] = {
    "forceinline": True,
    "fastmath": {"reassoc", "nsz", "arcp", "contract", "nnan"},
}
#: Decorators of functions of a single point or of a part of a list.
exact, fast = compiled(**EXACT), compiled(**FAST)
#: Decorators of loops over a part of a list; the returned values of all parts are added up.
exact_loop, fast_loop = by_items(summed, **EXACT), by_items(summed, **FAST)
#: Decorators of functions that consist of such loops.
exact_leader, fast_leader = leader(**EXACT), leader(**FAST)
