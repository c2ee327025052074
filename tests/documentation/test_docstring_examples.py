"""Every public function has an example; those with files of a user, which doctest skips, run on a small case.

All other examples are run as doctests of their modules.
"""

import doctest
import inspect

import pytest
from small_files import LEAK_TEST, TURNED_CASE

import femseal as fs

FUNCTIONS = [name for name in fs.__all__ if inspect.isfunction(getattr(fs, name))]
#: Classes that users make themselves.
MADE = [
    "HalfSpace",
    "RectangularSeal",
    "AnnularSeal",
    "Liquid",
    "IdealGas",
    "Scene",
    "Sampling",
    "Solid",
    "Topography",
]
#: These solve many cases.
SLOW = {"sweep", "calibrate"}


def examples(name):
    return doctest.DocTestParser().get_examples(inspect.getdoc(getattr(fs, name)))


ON_FILES = [name for name in FUNCTIONS if any(doctest.SKIP in e.options for e in examples(name))]


@pytest.mark.parametrize("name", FUNCTIONS + MADE)
def test_there_is_an_example(name):
    assert examples(name)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with the files that examples name, and finished runs."""
    folder = tmp_path_factory.mktemp("examples")
    quick = TURNED_CASE.replace(
        "[output]", "[output]\nbudget = false\npictures = false\nfields = false\nparaview = 'none'"
    )
    (folder / "seal.toml").write_text(quick, encoding="utf-8")
    (folder / "leak_test.csv").write_text(LEAK_TEST, encoding="utf-8")
    for name in ("seal", "a", "b"):
        fs.run(folder / "seal.toml", folder / "results" / name, workers=1)
    return folder


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=[pytest.mark.slow] if n in SLOW else []) for n in ON_FILES]
)
def test_an_example_on_files_runs(name, folder, monkeypatch):
    monkeypatch.chdir(folder)
    names = {name: getattr(fs, name)}
    for example in examples(name):
        source = (
            example.source.replace("results/seal", "results/new")
            if name == "run"
            else example.source
        )
        exec(compile(source, name, "exec"), names)
