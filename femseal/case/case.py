"""A case: the whole input of a run, as a TOML file whose quantities carry their units.

The file is checked as a whole before anything is computed; every fault is reported at once, with its key, what was
given and what is expected. `preparation.prepare` turns a case into the objects the studies take.
"""

from __future__ import annotations

import tomllib
from os import PathLike
from os.path import abspath, isfile
from pathlib import Path
from typing import Any, Literal

from pydantic import Field, ValidationError, model_validator

from ..base import InputError, InputErrors, shortened, to_text
from ..base.leak_rates import check_classes
from ..contact import ContactLaw, softer_of
from ..fluids import leak_basis, potential_of
from ..seal.layouts import Layout, MeshLayout
from ..solids_and_loads import Solid, contact_modulus
from .case_tables import (
    CellsTable,
    ContactTable,
    FlowTable,
    OutputTable,
    SolidTable,
    StochasticTable,
    with_named_solids,
)
from .faces import Face, FileFace, SurfaceTable
from .fault_report import case_faults, meant_in, with_lines
from .faults import INTERNAL, fault, faults_of
from .kinds import (
    AnyFluid,
    AnySeal,
    AnySeat,
    with_absolute_pressures,
    with_inlet_pressure,
    with_named_fluids,
)
from .load import LoadTable
from .values import Accuracy, Duration, FileSize, Number, Table, key, listed

#: No case is larger [byte].
_LARGEST_FILE = 1_000_000

#: Tables in which what is left out is filled in.
_FILLED = (
    "surface",
    "material",
    "counter_material",
    "fluid",
    "seal",
    "seat",
    "stochastic",
    "output",
)

Method = Literal["deterministic", "two-scale", "blocks", "stochastic"]


class Case(Table):
    """A validated case, all values in SI."""

    title: str = key("heading of the report", "", start="My seal", max_length=200)
    method: Method = key("how leakage is computed", "stochastic", start="stochastic")
    compare: tuple[Method, ...] = key("further methods to compare", (), example=["two-scale"])
    accuracy: Accuracy | None = key(
        "wanted relative error of the numbers; what the case leaves open is refined until then",
        None,
        example="10 %",
    )
    time_limit: Duration | None = key("of all attempts at that accuracy", None, example="1 h")
    seed: Number = key("of all draws, whatever the number of workers", 0, start=1)
    memory: FileSize | None = key(
        "limit above which a run is refused; the free memory unless given",
        None,
        example="16 GB",
        exclude=True,
    )
    face: tuple[Face, ...] = key(
        "the rough face; two, each under [[face]], are summed",
        needed="without a `path` or `places`",
        min_length=1,
        max_length=2,
    )
    surface: SurfaceTable = key("repair of measured faces, and conditioning", SurfaceTable())
    material: SolidTable = key("the solid of the face")
    counter_material: SolidTable | None = key(
        "the solid of the counter-face; rigid and flat without this table", None
    )
    load: LoadTable = key(
        'nominal contact pressures; or forces on the seal, "10 kN", or on its length, "200 N/mm"'
    )
    contact: ContactTable = key("how the faces touch", ContactTable())
    flow: FlowTable = key("how the fluid flows", FlowTable())
    fluid: AnyFluid = key("the fluid and its pressures", needed="without a `name`")
    seal: AnySeal = key(
        "shape of the seal; a strip has its length in [stochastic]",
        {"kind": "rectangular"},
        validate_default=True,
    )
    seat: AnySeat = key(
        "form of the seat, added to the roughness",
        {"kind": "flat"},
        since="0.2",
        validate_default=True,
    )
    cells: CellsTable | None = key(
        "pieces of the face, of several places of each",
        None,
    )
    stochastic: StochasticTable | None = key("seals that are drawn", None)
    output: OutputTable = key("what is written, and how", OutputTable())
    folder: Path = Field(default=Path(), exclude=True)
    named_warnings: tuple[str, ...] = Field(default=(), exclude=True)

    @model_validator(mode="before")
    @classmethod
    def _filled(cls, data: dict[str, Any]) -> dict[str, Any]:
        # what is no table has a fault of its own
        odd = {name: data[name] for name in _FILLED if not isinstance(data.get(name, {}), dict)}
        data = with_absolute_pressures(_with_what_is_open(data | {name: {} for name in odd}))
        warnings: list[str] = []
        data = with_named_fluids(with_inlet_pressure(data), warnings)
        data = with_named_solids(data, warnings) | {"named_warnings": tuple(warnings)}
        if "face" in data:
            data["face"] = listed(data["face"])
        return _with_detrending(data) | odd

    @model_validator(mode="after")
    def _complete(self) -> Case:
        """Raise a fault if keys of several tables do not go together."""
        if self.accuracy is not None and not self.output.budget:
            raise fault(
                "output.budget", "false with accuracy", "true: attempts end by their error budget"
            )
        if self.time_limit is not None and self.accuracy is None:
            raise fault(
                "time_limit", "a time without accuracy", "one with accuracy, whose attempts it ends"
            )
        if self.load.unit == "Pa" and self.load.highest >= self.law.capacity:
            expected = f"pressures below the hardness, {to_text(self.law.capacity, 'Pa')}"
            raise fault("load", to_text(self.load.highest, "Pa"), expected)
        for name, fluid in (("fluid", self.fluid), ("output.test_fluid", self.output.test_fluid)):
            if fluid is None:
                continue
            if not (inlet := fluid.inlet_pressure) > (outlet := fluid.outlet_pressure):
                expected = f"a pressure above that of the outlet, {to_text(outlet, 'Pa')}"
                raise fault(f"{name}.inlet_pressure", to_text(inlet, "Pa"), expected)
            with faults_of(name):
                potential_of(fluid.fluid, "inlet_pressure", fluid.inlet_pressure)
        self._check_output()
        for face in (face for face in self.face if isinstance(face, FileFace)):
            for table in face.each(self.folder):
                self._check_file(
                    "face.path" if face.places is None else "face.places", table.path or Path()
                )
        if isinstance(first := self.face[0], FileFace) and first.placement:
            raise fault("face.0", ", ".join(sorted(first.placement)), "that in the second face")
        self._check_seal()
        self._check_map()
        self._check_form()
        self._check_seat()
        return self

    def _check_file(self, key: str, path: Path) -> None:
        """Raise a fault if a file relative to the case does not exist."""
        if not isfile(tried := self.folder / path):
            there = f"; none is at {shortened(abspath(tried))}" if tried.name.isprintable() else ""
            raise fault(key, f"'{shortened(path)}'", f"a file that exists{there}")

    def _check_output(self) -> None:
        """Raise a fault if the unit or a class of leakage does not go with the fluid that it is of."""
        output = self.output
        drop = (output.test_fluid or self.fluid).state.pressure_drop
        basis, test = (
            leak_basis(fluid.fluid, 1.0, pressure_drop=drop, **output.valve)
            for fluid in (self.fluid, output.test_fluid or self.fluid)
        )
        if (
            output.unit is not None
            and (lack := basis.lacks(output.unit))
            and test.lacks(output.unit)
        ):
            kind = "gas" if basis.is_gas else "liquid"
            raise fault("output.leakage_unit", f"{output.unit.name} for a {kind}", lack)
        with faults_of("output"):
            check_classes(output.classes, output.nominal_diameter, test)

    def _check_seal(self) -> None:
        """Raise a fault if the shape of the seal does not go with the method, the lengths or the files."""
        layout, table = self.layout, self.stochastic
        if not layout.has_length and "stochastic" not in self.methods:
            given = f"{layout.kind} with the method {self.method}"
            raise fault("seal.kind", given, "it with stochastic, which draws its tiles")
        for name in ("length", "breadth") if table is not None and not layout.has_length else ():
            if (value := getattr(table, name)) is not None:
                given = to_text(value, "m")
                raise fault(
                    f"stochastic.{name}",
                    given,
                    f"none with a seal of kind {layout.kind}: it has its own",
                )
        self._check_inlets()
        for name, path in self.seal.files():
            self._check_file(f"seal.{name}", path)

    def _check_drawn_alone(self, key: str, given: str, why: str) -> None:
        """Raise a fault if what a key gives is not for drawn seals alone."""
        if others := self.methods - {"stochastic"}:
            raise fault(
                key,
                f"{given} with the method {', '.join(sorted(others))}",
                f"stochastic alone: {why}",
            )

    def _check_inlets(self) -> None:
        """Raise a fault if pressures of the inlets do not go with the outlet, the methods or a test fluid."""
        own, outlet = getattr(self.layout, "inlet_pressures", {}), self.fluid.outlet_pressure
        for name, pressure in own.items():
            if not pressure > outlet:
                expected = f"a pressure above that of the outlet, {to_text(outlet, 'Pa')}"
                raise fault(f"seal.inlet.{name}", to_text(pressure, "Pa"), expected)
        if own:
            self._check_drawn_alone("seal.inlet", "pressures", "a face has one inlet")
        if own and self.output.test_fluid is not None:
            raise fault(
                "output.test_fluid",
                "one with pressures of the inlets in seal.inlet",
                "none with them",
            )

    def _check_seat(self) -> None:
        """Raise a fault if the form of the seat does not go with boundary, faces or map, or its file does not exist."""
        kind = self.seat.kind
        if kind == "flat":
            return
        if self.contact.boundary[0] != "free":
            raise fault(
                "contact.boundary",
                f"{self.contact.boundary[0]} along x1 with a {kind} seat",
                "free along x1",
            )
        least = _least_detrend(kind)
        if any(isinstance(face, FileFace) for face in self.face) and self.surface.detrend < least:
            given = f"{self.surface.detrend} with a {kind} seat: the form would count twice"
            raise fault("surface.detrend", given, f"{least}: the form is that of [seat]")
        if self.load.map is not None:
            raise fault(
                "load.map",
                f"a map with a {kind} seat",
                "none: the form gives the pressure of the rows",
            )
        if self.layout.kind == MeshLayout.kind:
            raise fault("seal.kind", f"{self.layout.kind} with a {kind} seat", "a strip or a ring")
        if (path := getattr(self.seat, "path", None)) is not None:
            self._check_file("seat.path", path)

    def _check_form(self) -> None:
        """Raise a fault if forms of the seal do not go with the method or a map."""
        if not self.seal.form:
            return
        self._check_drawn_alone("seal.form", "a form", "a face has the form that was measured")
        if self.load.map is not None:
            raise fault(
                "load.map",
                "a map with seal.form",
                "one of them: the form gives the pressure of the tiles",
            )

    def _check_map(self) -> None:
        """Raise a fault if a map of the pressure does not go with the method, or its file does not exist."""
        if self.load.map is None:
            return
        self._check_drawn_alone("load.map", "a map", "a face has one nominal pressure")
        for path in self.load.files:
            self._check_file("load.map.path", path)

    def __repr__(self) -> str:
        highest = to_text(self.load.highest, self.load.unit, 3)
        return f"<femseal.Case {self.title!r}: {', '.join(sorted(self.methods))}, loads up to {highest}>"

    __str__ = __repr__

    @property
    def layout(self) -> Layout:
        """The shape of the seal."""
        return self.seal.make(self.folder)

    @property
    def methods(self) -> set[str]:
        """The method and the methods to compare it with, as given."""
        return {self.method, *self.compare}

    @property
    def solids(self) -> tuple[Solid, Solid | None]:
        """The two bodies; None is rigid."""
        counter = self.counter_material
        return self.material.solid, None if counter is None else counter.solid

    @property
    def law(self) -> ContactLaw:
        """Contact law of the softer solid, at each depth where their curves cross; elastic where none yields."""
        return softer_of(
            self.material.law, None if self.counter_material is None else self.counter_material.law
        )

    @property
    def softer(self) -> str:
        """Key of the table of the softer solid, whose hardness decides."""
        tables = {"material": self.material, "counter_material": self.counter_material}
        laws = {
            name: table.law.mean_hardness for name, table in tables.items() if table is not None
        }
        return min(laws, key=lambda name: laws[name])

    @property
    def hardness_tolerance(self) -> float:
        """Relative error of the hardness of the softer solid, for the error budget."""
        return float(getattr(self, self.softer).hardness_tolerance)

    @property
    def modulus(self) -> float:
        """Contact modulus [Pa]."""
        return contact_modulus(*self.solids)

    def echo(self) -> dict[str, Any]:
        """The case in SI, as plain data."""
        return self.model_dump(mode="json", exclude_none=True)


def _least_detrend(kind: object) -> int:
    """Least order of the form that is taken off a measured face on a seat of a kind, that it does not count twice."""
    return {"flat": 0, "tilted": 1}.get(str(kind), 2)


def _with_detrending(data: dict[str, Any]) -> dict[str, Any]:
    """The data of a case whose measured faces lose the form that its seat gives them, where it does not say what."""
    faces = data.get("face")
    measured = isinstance(faces, list) and any(
        isinstance(face, dict) and face.get("kind") == "file" for face in faces
    )
    least = _least_detrend(data["seat"].get("kind")) if measured and "seat" in data else 0
    if least <= SurfaceTable().detrend:
        return data
    return data | {"surface": {"detrend": least} | data.get("surface", {})}


def _with_what_is_open(data: dict[str, Any]) -> dict[str, Any]:
    """The tables of a case, with those that its methods need and it leaves out.

    With `accuracy` and no method, the method is "stochastic" if seals are to be drawn: with a table for it, or a shape
    with a length of its own. Else it is "deterministic", which "auto" is too.
    """
    has_length = data.get("seal", {}).get("kind", "rectangular") != "rectangular"
    is_face = data.get("accuracy") is not None and "stochastic" not in data and not has_length
    method = data.get("method", "deterministic" if is_face else "stochastic")
    method = "deterministic" if method == "auto" else method
    compare = data.get("compare", ())
    drawn = method == "stochastic" or (isinstance(compare, list) and "stochastic" in compare)
    return ({"stochastic": {}} if drawn else {}) | data | {"method": method}


def load_case(path: str | PathLike[str]) -> Case:
    """Read and validate a case file.

    Parameters
    ----------
    path : a TOML file; paths in it are relative to its folder.

    Raises
    ------
    InputError : the file is missing or is not TOML, or any of its values cannot be used; one line for each fault.

    Examples
    --------
    >>> case = load_case("seal.toml")  # doctest: +SKIP
    >>> case.method, case.seed  # doctest: +SKIP
    """
    data, folder = read_case(path)
    try:
        return parse_case(data, folder)
    except InputError as error:
        raise with_lines(error, Path(path).read_text(encoding="utf-8-sig")) from None


def read_case(path: str | PathLike[str]) -> tuple[dict[str, Any], Path]:
    """Tables of a case file, not yet validated, and its folder.

    Raises InputError: the file is missing or is not TOML.
    """
    path = Path(path)
    try:
        # a pipe or a device may have no end
        if path.exists() and not path.is_file():
            raise InputError("case", f"'{path}', which is no file", "a TOML file")
        with path.open("rb") as file:
            content = file.read(_LARGEST_FILE + 1)
    except OSError as error:
        expected = f"a file that can be read ({error.strerror}: {shortened(abspath(path))})"
        raise InputError("case", f"'{path}'", expected) from None
    if len(content) > _LARGEST_FILE:
        given = f"'{path}' of more than {_LARGEST_FILE:.0e} bytes"
        raise InputError("case", given, "a TOML file of a case")
    try:
        return tomllib.loads(content.decode("utf-8-sig").replace("\r\n", "\n")), path.parent
    except (ValueError, RecursionError) as error:  # also of a number with thousands of digits
        meant = meant_in(content.decode("utf-8-sig", "replace"), str(error))
        expected = f"a TOML file in UTF-8 ({shortened(error, 120)}){meant}"
        raise InputError("case", f"'{path}', which is not TOML", expected) from None


def parse_case(data: dict[str, Any], folder: Path = Path()) -> Case:
    """Validate a case given as a dictionary; paths in it are relative to `folder`.

    Raises InputError: one line for each fault.
    """
    for name in INTERNAL:
        if name in data:
            raise InputError(name, "a value", "no such key")
    try:
        return Case.model_validate({**data, "folder": folder})
    except RecursionError:
        raise InputError(
            "case", "lists or tables too deep in each other", "the tables of a case"
        ) from None
    except ValidationError as error:
        raise InputErrors([_named(found, data) for found in case_faults(Case, error)]) from None


def _named(found: InputError, data: dict[str, Any]) -> InputError:
    """A fault by the key of the file, where a single table of several possible ones has no number."""
    what = found.what
    if isinstance(data.get("face"), dict) and what.startswith("face.0"):
        what = what.replace("face.0", "face", 1)
    if isinstance(data.get("load"), dict) and isinstance(data["load"].get("map"), dict):
        what = what.replace("load.map.0", "load.map", 1)
    return InputError(what, found.given, found.expected)
