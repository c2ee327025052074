"""Imports run down the flow only, and the package is quick to import."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import femseal

ROOT = Path(femseal.__file__).parent
#: A module may import modules of a lower number, or of its own package.
LAYERS = {
    "errors": 0,
    "checks": 1,
    "files": 1,
    "machine": 1,
    "quantities": 1,
    "materials": 1,
    "fluids": 1,
    "analytic": 1,
    "parallel": 2,
    "drawing": 2,
    "showing": 2,
    "topography": 3,
    "contact": 4,
    "factors": 5,
    "flow": 5,
    "scales": 6,
    "seal": 7,
    "studies": 8,
    "output": 9,
    "case": 10,
    "versions": 1,
    "checkpoint": 10,
    "forecast": 11,
    "schema": 11,
    "survey": 11,
    "job": 11,
    "accuracy": 12,
    "cli": 13,
}
HEAVY = ("matplotlib", "jinja2", "vtk", "vtkmodules", "pyvista", "meshio", "SurfaceTopography", "distributed", "pyamg")
MODULES = sorted(p for p in ROOT.rglob("*.py") if p != ROOT / "__init__.py")


def _for_type_checkers(node):
    return isinstance(node, ast.If) and isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING"


def _imports(path):
    """(first part below femseal or outside package, whether it is imported when the module is)."""
    parts = path.relative_to(ROOT).with_suffix("").parts
    package = parts[:-1]  # for a package's __init__ this is the package itself
    tree = ast.parse(path.read_text(encoding="utf-8"))
    later = [n for n in ast.walk(tree) if isinstance(n, ast.FunctionDef) or _for_type_checkers(n)]
    inside = {id(n) for f in later for n in ast.walk(f)}
    for node in ast.walk(tree):
        top = id(node) not in inside
        if isinstance(node, ast.Import):
            yield from ((a.name, top) for a in node.names)
        elif isinstance(node, ast.ImportFrom):
            if node.module == "femseal" and node.level == 0:
                yield from ((f"femseal.{a.name}", top) for a in node.names)
            elif node.level == 0:
                yield node.module, top
            else:
                base = package[: len(package) - node.level + 1]
                names = [node.module] if node.module else [a.name for a in node.names]
                yield from (("femseal." + ".".join((*base, name)), top) for name in names)


@pytest.mark.parametrize("path", MODULES, ids=lambda p: str(p.relative_to(ROOT)))
def test_imports_run_downwards(path):
    own = path.relative_to(ROOT).parts[0].removesuffix(".py")
    assert own in LAYERS, f"{own} has no place in the flow"
    for name, _ in _imports(path):
        parts = name.split(".")
        if parts[0] == "femseal" and len(parts) > 1 and parts[1] in LAYERS and parts[1] != own:
            assert LAYERS[parts[1]] < LAYERS[own], f"{own} imports {parts[1]}"


def test_contact_and_flow_do_not_know_each_other():
    for package, other in (("contact", "flow"), ("flow", "contact")):
        for path in (ROOT / package).glob("*.py"):
            assert not [n for n, _ in _imports(path) if n.startswith(f"femseal.{other}")]


@pytest.mark.parametrize("path", MODULES, ids=lambda p: str(p.relative_to(ROOT)))
def test_heavy_libraries_are_imported_where_they_are_used(path):
    heavy = [name for name, top in _imports(path) if top and name.split(".")[0] in HEAVY]
    assert not heavy


def test_analytic_needs_numpy_only():
    roots = {name.split(".")[0] for name, _ in _imports(ROOT / "analytic.py")}
    assert roots <= {"__future__", "math", "collections", "typing", "numpy"}


def test_import_loads_nothing_until_it_is_used():
    code = "import sys, femseal; print([m for m in ('numba', 'scipy', 'skfem', 'xarray') if m in sys.modules])"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout.strip() == "[]"


def test_every_public_name_is_there():
    for name in femseal.__all__:
        assert getattr(femseal, name) is not None
    with pytest.raises(AttributeError, match="nonsense"):
        femseal.nonsense  # noqa: B018
