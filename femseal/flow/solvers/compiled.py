"""How loops over the levels of multigrid are compiled."""

from __future__ import annotations

from typing import Any

COMPILED: dict[str, Any] = {
    "cache": True,
    "nogil": True,
    "error_model": "numpy",
    "fastmath": {"reassoc", "contract", "arcp", "nsz"},
}
