"""CONTRIBUTING names files, functions and tests that exist."""

import importlib
import re
from pathlib import Path

import femseal

ROOT = Path(__file__).parents[2]
TEXT = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
PACKAGE = Path(femseal.__file__).parent
NAMES = sorted({*re.findall(r"`([^`\n]+)`", TEXT)})
#: Folders from which a file is named.
FOLDERS = (ROOT, PACKAGE)
#: Folders of results, which a run makes.
OF_RESULTS = ("vtk/", "fields/")


def named_files():
    """Names of files and folders, also those of commands such as `python tests/x.py`."""
    for name in NAMES:
        for word in name.partition("::")[0].split():
            is_path = re.fullmatch(r"[\w./-]+", word) and ("/" in word or word.endswith(".py"))
            if is_path and not word.startswith(OF_RESULTS):
                yield word


def test_every_file_that_is_named_exists():
    files = [*named_files()]
    assert len(files) > 30
    made = {"docs/_build"}
    missing = {n for n in files if not any((folder / n).exists() for folder in FOLDERS)}
    assert missing <= made


def test_every_test_that_is_named_exists():
    tests = [name.split("::") for name in NAMES if "::" in name]
    assert tests
    for path, name in tests:
        assert f"def {name}(" in (ROOT / path).read_text(encoding="utf-8")


def test_every_name_of_the_package_exists():
    """Those with a dot, such as `forms.darcy_flow` or `base.fields.declared`, of a module of the package."""
    modules = {path.stem: path for path in PACKAGE.rglob("*.py")}
    found = 0
    for name in NAMES:
        *path, attribute = name.split(".")
        is_name = path and all(part.isidentifier() for part in [*path, attribute])
        if (
            not is_name
            or path[-1] not in modules
            or attribute in ("py", "toml", "md", "nc", "csv", "html", "xlsx")
        ):
            continue
        module = modules[path[-1]].relative_to(PACKAGE.parent).with_suffix("")
        assert hasattr(importlib.import_module(".".join(module.parts)), attribute), name
        found += 1
    assert found > 3


def test_every_class_and_constant_that_is_named_exists():
    source = "\n".join(path.read_text(encoding="utf-8") for path in PACKAGE.rglob("*.py"))
    tests = "\n".join(path.read_text(encoding="utf-8") for path in (ROOT / "tests").rglob("*.py"))
    of_package = [n for n in NAMES if re.fullmatch(r"[A-Z][A-Za-z]+|[A-Z_]{4,}", n)]
    assert len(of_package) > 10
    missing = {n for n in of_package if not re.search(rf"\b{n}\b", source + tests)}
    assert missing == set()
