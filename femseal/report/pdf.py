"""The report as PDF: printed by a browser without a window, or else by WeasyPrint."""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
from importlib.util import find_spec
from pathlib import Path

from ..base.errors import FemsealError, InputError
from ..base.files import replacing

#: Browsers that print a page by `--headless --print-to-pdf`, by the names of their commands.
BROWSERS = (
    "chromium",
    "chromium-browser",
    "google-chrome",
    "google-chrome-stable",
    "chrome",
    "microsoft-edge",
    "msedge",
)
#: Longest time that a browser may take [s].
_PATIENCE = 120


def write_pdf(page: str | os.PathLike[str], path: str | os.PathLike[str] | None = None) -> Path:
    """Print a page as PDF.

    Parameters
    ----------
    page : the HTML file. path : of the PDF; beside the page unless given.

    Returns
    -------
    Path of the PDF; it is written whole or not at all.

    Raises
    ------
    InputError : neither a browser nor WeasyPrint is there.
    FemsealError : the browser did not print.
    """
    page = Path(page)
    target = page.with_suffix(".pdf") if path is None else Path(path)
    browser = find_browser()
    if browser is None and find_spec("weasyprint") is None:
        expected = f"one of the browsers {', '.join(BROWSERS)} on the path, or `pip install weasyprint`"
        raise InputError("PDF", "no program that prints a page", f"{expected}; or print report.html from a browser")
    with replacing(target) as temporary:
        if browser is not None:
            _print(browser, page, temporary)
        else:
            from weasyprint import HTML

            HTML(filename=str(page)).write_pdf(str(temporary))
    return target


def find_browser() -> str | None:
    """Command of the first browser of `BROWSERS` on the path; None without one."""
    return next(filter(None, map(shutil.which, BROWSERS)), None)


def _print(browser: str, page: Path, target: Path) -> None:
    """Have a browser print a page, in a profile of its own."""
    flags = ["--headless", "--disable-gpu", "--no-pdf-header-footer", f"--print-to-pdf={target.resolve()}"]
    # within a container the root user has no sandbox
    flags += ["--no-sandbox"] if getattr(os, "geteuid", lambda: 1)() == 0 else []
    with tempfile.TemporaryDirectory() as profile:
        command = [browser, *flags, f"--user-data-dir={profile}", page.resolve().as_uri()]
        try:
            done = subprocess.run(command, capture_output=True, timeout=_PATIENCE, check=False)
        except (OSError, subprocess.TimeoutExpired) as error:
            raise FemsealError(f"PDF: '{browser}' did not print the page ({error})") from error
    if done.returncode or not target.read_bytes().startswith(b"%PDF"):
        last = (done.stderr.decode(errors="replace").strip().splitlines() or ["no message"])[-1]
        raise FemsealError(f"PDF: '{browser}' did not print the page ({last})")
