"""Every command that README and documentation write down does its work as it stands there, with its folder, on a small case.

The commands are read from the pages, so that a new one is run without being entered here. Stopping and going on under
each scheduler is tested in execution/test_mappers.py.
"""

import json
import re
import shlex
import shutil
from contextlib import contextmanager, nullcontext
from itertools import count
from pathlib import Path

import pytest
from numpy.testing import assert_array_equal
from small_files import LEAK_TEST, TURNED_CASE, write_map
from typer.main import get_command

import femseal as fs
from femseal.cli import app
from femseal.execution.run import COMPILING

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md"))]
PAGES += sorted((ROOT / "docs" / "tutorials").glob("*.md"))
PAGES = [
    page for page in PAGES if page.name not in ("command_line.md", "case_keys.md")
]  # generated
#: What the pages leave open, or what is too large to be run here, and a small file in its place.
SMALL = {
    "CASE": "seal.toml",
    "FILE": "written.file",
    "N": "2",
    "face.plu": "face.x3p",
    "examples/turned_seal.toml": "seal.toml",
    "examples/self_affine_seal.toml": "seal.toml",
    "examples/silver_ring.toml": "seal.toml",
    "examples/gasket_seal.toml": "gasket.toml",
    "examples/leak_test.toml": "seal.toml",
    "examples/leak_test.csv": "leak_test.csv",
}


def documented():
    """Commands of the pages as they are written, without comments and what stands before `femseal`."""
    found = set()
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        blocks = "".join(re.findall(r"(?s)```sh\n(.*?)```", text))
        lines = blocks.replace("\\\n", " ").splitlines()
        lines += re.findall(r"(?<!`)`([^`]+)`(?!`)", re.sub(r"(?s)```.*?```", "", text))
        options = re.findall(r"(?m)^\| `(--[^`]+)` \|", text)
        lines += [f"femseal run CASE -o DIR {option}" for option in options]
        for line in lines:
            words = " ".join(line.split("#")[0].split())
            command = re.search(r"(?:^|&& |/)femseal ([^#\[]\S*(?: .*)?)$", words)
            # `new --drawing` names the option; without a file it asks questions
            is_name = command and command[1].startswith("new --")
            if command and not is_name and "=" not in command[1].split()[0]:
                found.add(command[1].strip())
    return sorted(found)


def forms(command):
    """A command with all that it leaves open, and without."""
    optional = re.compile(r" \[([^\]]+)\]")
    return {optional.sub(r" \1", command), optional.sub("", command)}


def small(form, address):
    """Its arguments, with small files and numbers for what the page leaves open; each DIR is another folder."""
    folders = (f"results/{n}" for n in count(1))
    given = {**SMALL, "ADDRESS": address, "tcp://…": address}
    return [
        next(folders) if word == "DIR" else given.get(word, word)
        for word in shlex.split(form)
        if word != "…"
    ]


COMMANDS = documented()
#: One form of each, by what it does here.
FORMS = sorted(
    {str(small(f, f)): f for c in COMMANDS if " " in c for f in sorted(forms(c))}.values()
)
#: These start processes, or run several cases.
SLOW = {
    "sweep seal.toml stochastic.length=1mm,10mm,100mm -o results/lengths",
    "sweep seal.toml seed=1,2 material.hardness=0.35GPa,0.8GPa -o results/hardness",
    "run CASE -o DIR --workers N",
    "run CASE -o DIR --scheduler local",
    "run examples/gasket_seal.toml -o results/gasket",
    "sweep seal.toml material.hardness=3GPa,4GPa face.pitch=40um,60um",
    "calibrate seal.toml leak_test.csv -o results/calibrated",
}

#: Warnings that are right for the small files, though not for the files of the pages: the gasket has large elements,
#: and a soft face carries the loads of a hard one.
WARNINGS = {
    "run examples/gasket_seal.toml -o results/gasket": ("The leakage scatters too much",),
    "sweep seal.toml seed=1,2 material.hardness=0.35GPa,0.8GPa -o results/hardness": (
        "Most of the surface is plastic",
        "The softer part may yield as a whole",
    ),
}


def gasket():
    """The shipped case of a gasket with few pixels, loads and seals."""
    text = (ROOT / "examples" / "gasket_seal.toml").read_text(encoding="utf-8")
    text = text.replace("../meshes", str(ROOT / "meshes"))
    for pattern, new in (
        (r"^points = .*", "points = [64, 128]"),
        (r"^loading = .*", 'loading = ["80 MPa", "200 MPa"]'),
        (r"^unloading = .*", 'unloading = ["80 MPa"]'),
        (r"^realisations = .*", "realisations = 3"),
    ):
        text, changed = re.subn(pattern, new, text, flags=re.MULTILINE)
        assert changed
    return text


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """The folder of a finished run of the small case."""
    folder = tmp_path_factory.mktemp("finished")
    (folder / "seal.toml").write_text(TURNED_CASE, encoding="utf-8")
    fs.run(folder / "seal.toml", folder / "results", workers=1)
    return folder / "results"


@pytest.fixture
def place(tmp_path, monkeypatch):
    """The working directory, with the files that the commands name, on a machine of one core."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("joblib.cpu_count", lambda *a, **k: 1)
    for name, text in (
        ("seal.toml", TURNED_CASE),
        ("leak_test.csv", LEAK_TEST),
        ("gasket.toml", gasket()),
    ):
        Path(name).write_text(text, encoding="utf-8")
    write_map("face.x3p", 1)
    return tmp_path


def written(path):
    """Files of an output, or of one for each step, none of which is empty."""
    files = [*path.parent.glob(f"{path.stem}*{path.suffix}"), *path.rglob("*")]
    return [p.stat().st_size > 0 for p in files if p.is_file() and p.suffix != ".lock"]


@pytest.mark.parametrize(
    "form", [pytest.param(f, marks=[pytest.mark.slow] if f in SLOW else []) for f in FORMS]
)
def test_a_documented_command_does_its_work(form, femseal, place, finished):
    form, _, into = form.partition(" > ")
    with cluster() if "ADDRESS" in form or "tcp:" in form else nullcontext("") as address:
        arguments = small(form, address)
        command = next(word for word in arguments if not word.startswith("-"))
        outputs = {arguments[n + 1] for n, word in enumerate(arguments) if word == "-o"}
        if command == "new":
            Path(arguments[1]).unlink(missing_ok=True)
        for word in {word.split("=")[-1] for word in arguments} - outputs:
            if word.startswith("results/"):
                shutil.copytree(finished, word)
        code, said, complaint = femseal(*arguments)
    assert code == 0, said + complaint
    # log lines, the first compilation after an installation, and warnings of a small file
    expected = (" INFO ", COMPILING, *WARNINGS.get(form, ()))
    assert [line for line in complaint.splitlines() if not any(e in line for e in expected)] == []
    for output in outputs:
        assert (files := written(Path(output)))
        assert all(files)
    if into:
        assert json.loads(said)["properties"].keys() >= {"face", "load"}
    if command == "run" and "--help" not in arguments:
        (found,) = Path().rglob("results.nc")
        names = (found.parent / "files.txt").read_text("utf-8").split()
        assert {"results.nc", "report.html", "leakage.png"} <= {*names}
        assert all((found.parent / name).exists() for name in names)
        if "seal.toml" in arguments:
            leakage = fs.open_results(found.parent).leakage.values
            assert_array_equal(leakage, fs.open_results(finished).leakage.values)


@contextmanager
def cluster():
    """Address of a scheduler to which all that it is sent is pickled, as between processes."""
    distributed = pytest.importorskip("distributed")
    given = {"processes": False, "protocol": "tcp://", "dashboard_address": None}
    with distributed.LocalCluster(n_workers=1, threads_per_worker=1, **given) as it:
        yield it.scheduler_address


def test_pages_name_every_command_and_no_other():
    names = {
        word
        for command in COMMANDS
        for word in [command.removeprefix("--debug ").split()[0]]
        if word[0] != "-"
    }
    assert names == set(get_command(app).commands)


def test_the_pages_are_read():
    assert {
        "run CASE -o DIR --resume",
        "new seal.toml",
        "run CASE -o DIR --scheduler local",
    } <= set(COMMANDS)
    assert forms("export DIR -o gap.tif [--step 8]") == {
        "export DIR -o gap.tif --step 8",
        "export DIR -o gap.tif",
    }
    assert small("compare DIR DIR …", "") == ["compare", "results/1", "results/2"]
    assert not SLOW - set(FORMS)
