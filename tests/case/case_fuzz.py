"""Case files at random for tests: examples and the keys of the template, with values and text spoiled."""

import datetime
import json
import math
import re
import shutil
import tomllib
from copy import deepcopy
from pathlib import Path

import numpy as np
import pyvista as pv
from small_cases import STRIP, template_cases

from femseal.case import Case, case_template

ROOT = Path(__file__).parents[2]
#: Values that a key may be given and hardly ever takes.
JUNK = (
    *(math.nan, math.inf, -math.inf, 0, -0.0, -1, 1, 2, 7, 0.5, 1e308, 5e-324, 10**18, -(10**30)),
    *(True, False, "", " ", "\x00", "\x1b[31m", "é", "🜁" * 30, "a" * 5000),
    *("1,5 mm", "1 mm", "5 Pa", "5 MPa", "-3 MPa", "nan MPa", "inf m", "1e400 m", "0 m", "0 Pa"),
    *("1e30 m", "1e-30 m", "1e29 Pa", "1e-29 Pa", "210 GPa GPa", "1", "m", "10 kN", "200 N/mm"),
    *("20 °C", "-300 °C", "1 GB", "90 deg", "50 %", "1 mm\n", "..", "/", "/dev/zero", "none"),
    *("x1", "helium", "periodic", "free", [], {}, [[]], [{}], ["1 mm"], ["1 MPa", "2 MPa"]),
    *([1, 2, 3], [0, 0], [-1, 5], [1e9, 2], [10**9, 10**9], [2, 3], [97, 101], [True, False]),
    *(["a", 1, 2.0, []], {"kind": "liquid"}, {"kind": 3}, {"": 1}, {"a": {"b": {"c": {}}}}),
    *(datetime.date(2020, 1, 1), datetime.time(1, 2)),
)
_WORDS = ("nonsense", "", "kind", "title", "é", "a.b", "Young", "points\n", "__class__", "x" * 300)
#: Characters and cells of text that TOML reads in a way of its own.
_TEXTS = [
    *"\"'[]{}=#\n\\,.\x00\x7f\ud7ff\ufeffé🜁-+_\r\t",
    "'''",
    "nan",
    "1e999",
    "0x",
    "[face]\n",
    "kind = 3\n",
]


def spare_files(folder):
    """Put files that cases may name into a folder, small ones, some of them broken."""
    rng = np.random.default_rng(1)
    heights = 1e-7 * rng.standard_normal((24, 40))
    np.save(folder / "face.npy", heights)
    np.save(folder / "holes.npy", np.where(rng.random((24, 40)) < 0.01, np.nan, heights))
    np.save(folder / "words.npy", np.array(["a", "b"]))
    np.save(folder / "deep.npy", np.zeros((2, 3, 4)))
    np.savez(folder / "faces.npz", heights=heights, spacing=np.array([1e-6, 1e-6]))
    np.savetxt(folder / "face.txt", 1e6 * heights)
    (folder / "broken.x3p").write_bytes(b"PK\x03\x04" + bytes(100))
    (folder / "empty.txt").write_bytes(b"")
    (folder / "noise.csv").write_bytes(bytes(rng.integers(0, 256, 500, dtype=np.uint8)))
    (folder / "pressure.csv").write_text(
        "x,y,pressure\n0,0,1\n1,0,2\n0,1,3\n1,1,4\n", encoding="utf-8"
    )
    (folder / "here").mkdir()
    for mesh in ("ring.msh", "frame.msh"):
        shutil.copy(ROOT / "meshes" / mesh, folder / mesh)
    points = np.array([(x, y, 0.0) for x in (-0.03, 0.03) for y in (-0.03, 0.03)])
    field = pv.PolyData(points, faces=[4, 0, 1, 3, 2])
    field["pressure"], field["lay"] = np.arange(4.0), points
    field.cast_to_unstructured_grid().save(folder / "field.vtu")


def examples():
    """Cases to begin with: those of the examples and others, on small faces."""
    found = [
        tomllib.loads(path.read_text(encoding="utf-8"))
        for path in sorted((ROOT / "examples").glob("*.toml"))
    ]
    found += [*template_cases(), tomllib.loads(case_template(Case))]
    for case in found:
        face = case["face"] = dict(case["face"])
        if face["kind"] == "file":
            face |= {"path": "face.npy", "spacing": ["1 um", "1 um"]}
            case["surface"] = {"detrend": 1}
            case["cells"] = {"count": [1, 2]}
        else:
            face |= {"points": [64, 128]}
            case["cells"] = {"count": [2, 4]}
        if case.get("seal", {}).get("kind") == "mesh":
            case["seal"] |= {"path": "ring.msh", "inlet": "inlet", "outlet": "outlet"}
    turned = found[-1]
    plain = {key: turned[key] for key in ("face", "material", "load", "fluid")}
    alone = plain | {"method": "deterministic"}
    gas = {"name": "helium", "inlet_pressure": "10 bar", "outlet_pressure": "1 bar"}
    two = [turned["face"], STRIP["face"] | {"points": [64, 128], "size": ["240 um", "480 um"]}]
    bolted = {"kind": "angle", "fractions": [1.3, 0.7], "repeat": 8}
    classes = {"classes": ["TA Luft"], "leakage_unit": "mg/(m*s)", "test_fluid": gas}
    return [
        *found,
        alone,
        alone | {"fluid": gas, "method": "auto", "output": classes},
        turned | {"face": two},
        plain | {"accuracy": "20 %", "time_limit": "1 min"},
        turned | {"load": turned["load"] | {"map": bolted}, "stochastic": turned["stochastic"]},
        turned | {"compare": ["deterministic"], "surface": {"shortest_wave": "30 um"}},
    ]


class CaseFuzz:
    """Texts of case files by number: the same number gives the same text."""

    def __init__(self):
        self._examples = examples()

    def text(self, number):
        """Text of a case file, as bytes; those of the first numbers are not spoiled."""
        if number < len(self._examples):
            return toml(self._examples[number]).encode()
        rng = np.random.default_rng([31, number])
        case = self._pick(rng, self._examples)
        for _ in range(self._pick(rng, (1, 1, 1, 2, 2, 3, 4))):
            self._spoil(rng, case)
        text = toml(case)
        if rng.random() < 0.2:
            text = self._spoiled_text(rng, text)
        content = text.encode("utf-8", "surrogatepass")
        if rng.random() < 0.02:
            place = int(rng.integers(len(content) + 1))
            noise = bytes(rng.integers(0, 256, 3, dtype=np.uint8))
            content = content[:place] + noise + content[place:]
        return content

    @staticmethod
    def _pick(rng, values):
        return deepcopy(values[rng.integers(len(values))])

    def _spoil(self, rng, case):
        tables = list(_tables(case))
        table = self._pick(rng, range(len(tables)))
        table, other = tables[table], tables[rng.integers(len(tables))]
        keys, way = list(table), rng.integers(14)
        if not keys:
            return
        key = self._pick(rng, keys)
        if way < 2:
            table[key] = self._pick(rng, JUNK)
        elif way < 4:  # a key of another case, with its value
            known = self._pick(rng, [t for c in self._examples for t in _tables(c) if t])
            name = self._pick(rng, list(known))
            table[name] = known[name]
        elif way == 4:
            table.pop(key)
        elif way == 5:
            table[self._pick(rng, _WORDS)] = table.pop(key) if rng.random() < 0.5 else table[key]
        elif way == 6:
            table[key] = deepcopy(other)
        else:
            table[key] = self._bent(rng, table[key])

    def _bent(self, rng, value):
        """The value a little changed: another number, unit, length, or type."""
        if isinstance(value, bool):
            return not value
        if isinstance(value, (int, float)):
            factor = self._pick(rng, (-1, 0, 0.5, 2, 10, 1000))
            return type(value)(factor * self._pick(rng, (1, value)))
        if isinstance(value, str):
            factor = 10 ** (rng.uniform(-9, 9) if rng.random() < 0.3 else rng.uniform(-0.5, 0.5))
            number = re.sub(r"^-?\d+(\.\d+)?", lambda n: f"{float(n[0]) * factor:.6g}", value)
            units = ("m", "Pa", "um", "GPa", "", "K", "kg", "N/mm", "°")
            unit = re.sub(r"[A-Za-z°%]+.*$", self._pick(rng, units), value)
            others = (unit, value + "x", value[:-1], value * 2, [value], value.upper())
            return number if rng.random() < 0.5 else self._pick(rng, others)
        if isinstance(value, list) and value:
            inner = [self._bent(rng, each) if rng.random() < 0.5 else each for each in value]
            longer = value * self._pick(rng, (2, 3, 5, 20, 50, 3000))
            others = (value[:-1], value[::-1], inner, inner, value[0], [*value, []], longer)
            return self._pick(rng, others)
        return self._pick(rng, JUNK)

    def _spoiled_text(self, rng, text):
        lines = text.split("\n")
        for _ in range(rng.integers(1, 4)):
            at, other = (int(n) for n in rng.integers(len(lines), size=2))
            place = int(rng.integers(len(lines[at]) + 1))
            head, tail = lines[at][:place], lines[at][place:]
            ways = (
                [*lines[:at], lines[other], *lines[at:]],
                [*lines[:at], *lines[at + 1 :]],
                [*lines[:at], head + self._pick(rng, _TEXTS) + tail, *lines[at + 1 :]],
                [*lines[:at], head + tail[1:], *lines[at + 1 :]],
                lines[:at],
            )
            lines = self._pick(rng, ways) or [""]
        return self._pick(rng, ("\n", "\n", "\r\n")).join(lines)


def _tables(value):
    """Every table in a value."""
    if isinstance(value, dict):
        yield value
        value = [*value.values()]
    if isinstance(value, list):
        for each in value[:50]:
            yield from _tables(each)


def toml(case):
    """A case as text of TOML: values first, then tables."""
    lines, tables = [], []
    for key, value in case.items():
        if isinstance(value, dict):
            tables += [
                "",
                f"[{_key(key)}]",
                *(f"{_key(k)} = {_value(v)}" for k, v in value.items()),
            ]
        else:
            lines.append(f"{_key(key)} = {_value(value)}")
    return "\n".join(lines + tables) + "\n"


def _key(key):
    return key if re.fullmatch(r"[A-Za-z0-9_-]+", key) else json.dumps(key)


def _value(value):
    if isinstance(value, (bool, str)):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007F")
    if isinstance(value, (int, float)):
        return repr(value)
    if isinstance(value, list):
        return f"[{', '.join(map(_value, value))}]"
    if isinstance(value, dict):
        return f"{{{', '.join(f'{_key(key)} = {_value(each)}' for key, each in value.items())}}}"
    return value.isoformat()
