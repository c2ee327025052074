"""A hard scene and its outcome."""

import warnings
from collections.abc import Callable
from dataclasses import dataclass

from judges import Judge, numbers


@dataclass(frozen=True)
class HardScene:
    """A scene that is hard to solve, with what must come out.

    stage : "contact", "flow", "seal" or "chain". name : short and unique. what : the scene in words.
    must : judge of what comes out. run : computes it, a number or several; an error is an outcome too.
    slow : whether it takes more than about a second, and is run with the slow tests.
    """

    stage: str
    name: str
    what: str
    must: Judge
    run: Callable
    slow: bool = False

    def outcome(self):
        """Run the scene: whether what came is what must come, and what came, as text.

        A number that is not defined and a warning of numpy about one in femseal do not pass; an error passes where the
        judge expects it.
        """
        with warnings.catch_warnings():
            warnings.filterwarnings("error", category=RuntimeWarning, module="femseal")
            try:
                came = self.run()
            except Exception as error:  # whatever is raised is what came
                came = error
        return self.must.holds(came), numbers(came)
