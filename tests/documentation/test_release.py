"""Version and dependencies are the same wherever a release states them."""

import re
import tomllib
from pathlib import Path

import femseal as fs

ROOT = Path(__file__).parents[2]


def text(name):
    return (ROOT / name).read_text(encoding="utf-8")


def test_the_version_is_the_same_everywhere():
    assert re.search(r"(?m)^version: (.*)$", text("CITATION.cff"))[1] == fs.__version__
    assert re.search(r'(?m)^  version: "(.*)"$', text(".ci/conda/recipe.yaml"))[1] == fs.__version__
    assert (
        re.search(r"(?m)^## (\S+) \(\d{4}-\d\d-\d\d\)$", text("CHANGELOG.md"))[1] == fs.__version__
    )


def test_the_recipe_has_the_dependencies_of_the_package():
    project = tomllib.loads(text("pyproject.toml"))["project"]
    run = (
        text(".ci/conda/recipe.yaml")
        .partition("\n  run:\n")[2]
        .partition("\n\n")[0]
        .replace("-base", "")
    )
    listed = {line.strip("- ").replace(" ", "") for line in run.splitlines()}
    assert listed == {*project["dependencies"], f"python{project['requires-python']}"}


def test_the_paper_cites_what_it_lists():
    listed = re.findall(r"@article\{(\w+),", text("docs/paper.bib"))
    assert {*re.findall(r"(?<![\w.])@(\w+)", text("docs/paper.md"))} == {*listed}
