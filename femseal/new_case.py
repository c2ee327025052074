"""Define the command `femseal new`: a template, a case of a measured face, or a case from a drawing."""

import sys
from pathlib import Path
from typing import Annotated, Any

import typer

from .base import InputError, writing
from .execution.terminal import flag, option


def _drawing_option(help: str, default: str, *names: str) -> Any:
    """Return a command-line option for a value that is stated on a drawing or in a specification."""
    return typer.Option(
        *names, help=help, show_default=default, rich_help_panel="From a drawing (--drawing)"
    )


def new(
    path: Annotated[Path, typer.Argument(help="Case file to write.")] = Path("case.toml"),
    face: Annotated[
        Path | None,
        typer.Option(
            "--from",
            metavar="FILE",
            help="File of the measured face of the case.",
            show_default="none",
        ),
    ] = None,
    spacing: Annotated[
        tuple[str, str] | None,
        option("Size of a pixel of the face, such as '2 um' '2 um'.", "from the file"),
    ] = None,
    height_unit: Annotated[
        str | None, option("Unit of the heights in this file, such as um.", "from the file")
    ] = None,
    drawing: Annotated[
        bool,
        flag(
            "--drawing",
            "Write a case from what a drawing states; ask for values that no option gives.",
        ),
    ] = False,
    ra: Annotated[str | None, _drawing_option("Ra, such as 1.6um.", "none")] = None,
    rz: Annotated[str | None, _drawing_option("Rz, such as 8um.", "none")] = None,
    process: Annotated[
        str | None, _drawing_option("turned, ground, lapped or blasted.", "turned")
    ] = None,
    pitch: Annotated[
        str | None,
        _drawing_option("Feed per turn, or mean spacing RSm of the marks, such as 0.15mm.", "none"),
    ] = None,
    lay: Annotated[
        str | None, _drawing_option("Lay of the marks: circular, radial or spiral.", "circular")
    ] = None,
    inner_diameter: Annotated[
        str | None, _drawing_option("Inner diameter of the contact area.", "50 mm")
    ] = None,
    outer_diameter: Annotated[
        str | None, _drawing_option("Outer diameter of the contact area.", "54 mm")
    ] = None,
    metal: Annotated[
        str | None,
        _drawing_option(
            "Metal of the softer or plated face, such as 'copper, soft'; an unknown name, such as 'x', lists all.",
            "copper, soft",
        ),
    ] = None,
    hardness: Annotated[
        str | None,
        _drawing_option("Its hardness, such as 0.5GPa or '45 HV'.", "typical of the metal"),
    ] = None,
    plating: Annotated[
        str | None,
        _drawing_option("Metal of a plating on this face, such as 'silver, annealed'.", "none"),
    ] = None,
    plating_thickness: Annotated[
        str | None, _drawing_option("Thickness of the plating, such as 20um.", "none")
    ] = None,
    plating_hardness: Annotated[
        str | None,
        _drawing_option("Hardness of the plating, such as '60 HV'.", "typical of its metal"),
    ] = None,
    force: Annotated[
        str | None,
        _drawing_option(
            "Highest force between the faces in assembly, such as 80kN.", "0.3 of the hardness"
        ),
    ] = None,
    fluid: Annotated[str | None, _drawing_option("Fluid, by name.", "helium")] = None,
    inlet: Annotated[
        str | None, _drawing_option("Absolute pressure at the inlet.", "2 bar")
    ] = None,
    outlet: Annotated[
        str | None, _drawing_option("Absolute pressure at the outlet.", "1 bar")
    ] = None,
    limit: Annotated[
        str | None,
        _drawing_option(
            "Leakage class or largest leakage, such as '1e-3 mbar*L/s'.", "none", "--class"
        ),
    ] = None,
) -> None:
    """Write a commented case file: a template, a case for a measured face, or a case from the data on a drawing."""
    stated = {
        "ra": ra,
        "rz": rz,
        "process": process,
        "pitch": pitch,
        "lay": lay,
        "inner_diameter": inner_diameter,
        "outer_diameter": outer_diameter,
        "metal": metal,
        "hardness": hardness,
        "plating": plating,
        "plating_thickness": plating_thickness,
        "plating_hardness": plating_hardness,
        "force": force,
        "fluid": fluid,
        "inlet": inlet,
        "outlet": outlet,
        "limit": limit,
    }
    if path.exists():
        raise InputError("path", f"'{path}', which exists", "the name of a new file")
    first_stated = next((name for name, text in stated.items() if text is not None), None)
    if first_stated is not None and not drawing:
        option_name = {"limit": "--class"}.get(first_stated, f"--{first_stated.replace('_', '-')}")
        raise InputError(option_name, "without --drawing", "--drawing as well")
    if drawing and face is not None:
        raise InputError("--from", "together with --drawing", "either --from or --drawing")
    if drawing:
        from .preparation.case_of_drawing import case_of_drawing
        from .preparation.drawing_values import read_drawing

        is_terminal = sys.stdin.isatty() and sys.stdout.isatty()
        text = case_of_drawing(read_drawing(stated, _ask if is_terminal else None))
    elif face is None:
        from .case.case import Case
        from .case.template import case_template

        text = case_template(Case)
    else:
        from .preparation.case_of_face import case_of_face

        text = case_of_face(face, path.absolute().parent, spacing=spacing, height_unit=height_unit)
    with writing("path", path):
        path.write_text(text, encoding="utf-8")
    how = "run it as it is or edit it" if drawing else "edit it, then"
    typer.echo(f"{path} was written; {how}: femseal run {path}")


def _ask(question: str, assumed: str) -> str:
    """Ask a question in the terminal, and return the answer, or "" if the user accepts the default answer."""
    answer = typer.prompt(question, default=assumed, show_default=bool(assumed))
    return "" if answer == assumed else str(answer)
