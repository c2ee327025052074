"""A file of log lines that may fail, as on a full disk, without stopping what is logged."""

from __future__ import annotations

import logging
import sys
from contextlib import suppress
from pathlib import Path


class LogFile(logging.FileHandler):
    """Log lines in a file; on a full disk they end, while the run goes on.

    failure : the first error of the file, None while there is none.
    """

    failure: OSError | None = None

    def __init__(self, path: Path, mode: str = "a", delay: bool = False) -> None:
        super().__init__(path, mode=mode, encoding="utf-8", delay=delay)
        self.setFormatter(logging.Formatter("%(asctime)s %(levelname)s %(message)s"))

    def handleError(self, record: logging.LogRecord) -> None:
        """Keep the error; lines that cannot be written are lost."""
        error = sys.exc_info()[1]
        if isinstance(error, OSError):
            self.failure = self.failure or error

    def close(self) -> None:
        """Close the file as far as that goes."""
        with suppress(OSError):
            super().close()
