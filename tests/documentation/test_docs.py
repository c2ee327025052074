"""The documentation names what there is, and all of it; `.ci/run` builds it."""

import inspect
import re
import subprocess
import sys
from pathlib import Path

import pytest

import femseal

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
#: Made by the build.
MADE = ("gallery/", "command_line.md", "case_keys.md", "template.toml")
PAGES = sorted([*ROOT.glob("*.md"), *DOCS.rglob("*.md")])
PAGES = [
    page
    for page in PAGES
    if not {"_build", "gallery", "_examples"} & set(page.relative_to(ROOT).parts)
]


def test_every_public_name_is_in_the_reference_once():
    text = "".join(page.read_text(encoding="utf-8") for page in (DOCS / "api").glob("*.md"))
    assert (
        sorted(re.findall(r"auto(?:class|function):: femseal\.(\w+)(?![\w.])", text))
        == femseal.__all__
    )


def test_signatures_can_be_read():
    """`help` and notebooks show them; the types of numpy would fill lines."""
    values = {name: getattr(femseal, name) for name in femseal.__all__ if name != "Case"}
    is_error = {
        name: isinstance(v, type) and issubclass(v, Exception) for name, v in values.items()
    }
    signatures = {
        name: str(inspect.signature(value))
        for name, value in values.items()
        if callable(value) and not is_error[name]
    }
    long = [name for name, text in signatures.items() if "ndarray[" in text or "_Buffer" in text]
    assert len(signatures) > 40
    assert long == []


#: Looks every dotted name up as where nothing but the package itself has been imported.
LOOKED_UP = """
import sys
from functools import reduce
import femseal
for names in sys.argv[1:]:
    vars(femseal).pop(names.split(".")[0], None)
    try:
        reduce(getattr, names.split("."), femseal)
    except AttributeError as error:
        print(error)
"""


def test_every_documented_name_is_there_after_the_import_of_the_package():
    files = [
        page for page in PAGES if page.stem.lower() != "changelog"
    ]  # which has former names too
    files += (ROOT / "examples").glob("*.py")
    dotted = r"(?<![\w/.-])(?<!from )(?:fs|femseal)\.((?:\w+\.)*\w+)(?![\w/-])"
    names = {
        name for file in files for name in re.findall(dotted, file.read_text(encoding="utf-8"))
    }
    names = {name for name in names if not re.search(r"(^|\.)(css|json)$", name)}
    assert {"run", "analytic", "flow.forms", "load_case"} <= names
    names |= {"seal", "flow", "named_fluids"}
    done = subprocess.run(
        [sys.executable, "-c", LOOKED_UP, *names], capture_output=True, text=True, check=True
    )
    assert not done.stdout, done.stdout


def test_every_benchmark_has_its_page():
    included = {
        (page.parent / name).resolve()
        for page in DOCS.rglob("*.md")
        for name in re.findall(r"\{include\} (\S+)", page.read_text(encoding="utf-8"))
    }
    assert set((ROOT / "tests" / "benchmarks").glob("*.md")) <= included


@pytest.mark.parametrize("name", ["start.md", "tutorials/index.md", "tutorials/drawing.md"])
def test_the_first_pages_can_be_read_as_plain_files(name):
    """Viewers of repositories show directives and roles of Sphinx as code, without what they include."""
    text = (DOCS / name).read_text(encoding="utf-8")
    text = re.sub(r"```\{toctree\}\n:hidden:\n.*?```", "", text, flags=re.DOTALL)
    assert not re.search(r"^ *(```|:::)\{|\{(term|doc|ref|class|func)\}`", text, flags=re.MULTILINE)


def test_the_introduction_has_the_commands_of_the_readme():
    blocks = [
        re.search(r"```sh\n[^`]*-n 2\n```", path.read_text(encoding="utf-8"))
        for path in (ROOT / "README.md", DOCS / "start.md")
    ]
    assert blocks[0][0] == blocks[1][0]


@pytest.mark.parametrize("page", PAGES)
def test_files_that_pages_name_are_there(page):
    for name in re.findall(
        r"(?<![\w/])(?:examples|meshes)/[\w.]+", page.read_text(encoding="utf-8")
    ):
        assert (ROOT / name.rstrip(".")).exists(), name


@pytest.mark.parametrize("page", PAGES)
def test_links_of_pages_lead_somewhere(page):
    for target in re.findall(r"\]\((?!https?:)([^)#\s]+)[^)]*\)", page.read_text(encoding="utf-8")):
        if not any(made in target for made in MADE):
            assert (page.parent / target).exists(), target


@pytest.mark.parametrize("formula", [r"\bar p", r"\hat u"])
def test_bars_and_hats_of_formulas_stand_above_their_letters(formula, monkeypatch):
    """Chromium draws an accent of MathML through its letter."""
    pytest.importorskip("sphinx")
    from docutils import nodes

    monkeypatch.syspath_prepend(DOCS / "extensions")
    from formulas import mathml

    written = mathml(nodes.math("", formula))
    assert "<mover>" in written
    assert "accent" not in written
