"""What a case that asks for an accuracy may leave out: its method, and how seals of a shape of their own are drawn."""

from __future__ import annotations

from typing import Any


def with_what_is_open(data: Any) -> Any:
    """The tables of a case; one with `accuracy` and no method gets the method that its tables call for.

    It is "stochastic" if seals are to be drawn: with a table for it, or a shape with a length of its own, which takes
    windows under a uniform pressure. Else it is "auto".
    """
    if not isinstance(data, dict) or data.get("accuracy") is None:
        return data
    seal = data.get("seal")
    shaped = isinstance(seal, dict) and seal.get("kind", "rectangular") != "rectangular"
    drawn = data.get("stochastic")
    if shaped and data.get("method", "stochastic") == "stochastic" and isinstance(drawn, dict | None):
        drawn = {"pressure": "uniform"} | (drawn or {})
    found = {**data, "method": data.get("method", "auto" if drawn is None else "stochastic")}
    return found if drawn is None else found | {"stochastic": drawn}
