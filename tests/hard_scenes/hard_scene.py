"""A hard scene and its outcome."""

from __future__ import annotations

import signal
import threading
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from judges import Judge, numbers

#: Longest CPU time that a scene may take, compiling included [s].
LONGEST = 300.0


@dataclass(frozen=True)
class HardScene:
    """A scene that is hard to solve, with what must come out.

    name : short and unique. stage : "contact", "flow", "seal" or "chain". what : the scene in words.
    must : judge of what comes out. run : computes it, a number or several; an error is an outcome too.
    slow : whether it takes more than about a second, and is run with the slow tests. needs : module of an extra.
    """

    name: str
    stage: str
    what: str
    must: Judge
    run: Callable[[], Any]
    slow: bool = False
    needs: str = ""

    def outcome(self, longest: float = LONGEST) -> Outcome:
        """Run the scene, for `longest` seconds of CPU time at most.

        A number that is not defined and a warning of numpy about one in femseal do not pass; an error passes where the
        judge expects it.
        """
        start = time.perf_counter()
        came: Any
        with warnings.catch_warnings():
            warnings.filterwarnings("error", category=RuntimeWarning, module="femseal")
            try:
                with _time_limit(longest):
                    came = self.run()
            except Exception as error:  # whatever is raised is what came
                came = error
        return Outcome(self, numbers(came), self.must.holds(came), time.perf_counter() - start)


@dataclass(frozen=True)
class Outcome:
    """What came out of a scene. came : as text. within : whether it is what must come. seconds : of wall-clock time."""

    scene: HardScene
    came: str
    within: bool
    seconds: float


@contextmanager
def _time_limit(seconds: float) -> Iterator[None]:
    """Raise `TimeoutError` after so many seconds of CPU time, where the system has such an alarm and in the main thread."""
    if (
        not hasattr(signal, "SIGVTALRM")
        or threading.current_thread() is not threading.main_thread()
    ):
        yield
        return

    def late(*_: Any) -> None:
        raise TimeoutError(f"not done after {seconds:g} s")

    before = signal.signal(signal.SIGVTALRM, late)
    signal.setitimer(signal.ITIMER_VIRTUAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0)
        signal.signal(signal.SIGVTALRM, before)
