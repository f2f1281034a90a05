"""The machine file: what is read, what is refused and by which name, and that it writes back whole."""

from __future__ import annotations

import math
import re
import string
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from support import ROOT
from truepose.errors import InputError
from truepose.files import atomic_directory, atomic_write_text
from truepose.models.file.machine_file import MachineFile, read_machine, write_machine
from truepose.models.file.yaml_document import FastLoader, PlainLoader, document_text, read_document

BASIC = """\
schema: truepose/machine/1
name: rig
units: {length: mm, angle: deg}
mechanism: {type: serial, joints: []}
sensor: {type: pose, sigma: {xyz: 0.01, rot: 0.001}}
"""


def _read(tmp_path: Path, text: str) -> MachineFile:
    path = tmp_path / "machine.yaml"
    path.write_text(text, encoding="utf-8")
    return read_machine(path)


def _refusal(tmp_path: Path, text: str) -> str:
    with pytest.raises(InputError) as caught:
        _read(tmp_path, text)
    message = str(caught.value)
    assert message.startswith(str(tmp_path / "machine.yaml"))
    assert "\n" not in message
    return message


def test_values_are_in_internal_units(tmp_path: Path) -> None:
    machine = _read(
        tmp_path,
        BASIC.replace("length: mm", "length: m")
        + """\
gravity: [0, 0, -9.80665]
frames:
  base: {in: world, xyz: [1, 2, 3], rpy: [0, 0, 180], tolerance: {xyz: .inf}}
  tool: {in: flange, xyz: [0, 0, 0.12], tolerance: {xyz: [1e-3, 0, 0], rpy: 180}}
masses:
  payload: {kg: 2, com: [0, 0.012, 0.06], in: tool}
tolerances: {length: 1e-4, angle: 90}
drivers: [temperature.base, approach]
effects:
  - effect: joint-compliance
    place: [q2]
    parameters: {c: {value: 2.1e-1, unit: urad/(N*m), std: 1e-2}, k: 3}
    order: 2
""",
    )
    assert machine.frames.base.xyz == (1000.0, 2000.0, 3000.0)
    assert machine.frames.base.rpy == (0.0, 0.0, math.pi)
    assert machine.frames.base.tolerance.xyz == (math.inf, math.inf, math.inf)
    assert machine.frames.base.tolerance.rpy == (0.0, 0.0, 0.0)
    assert machine.frames.tool.tolerance.xyz == (1.0, 0.0, 0.0)
    assert machine.frames.tool.tolerance.rpy == (math.pi, math.pi, math.pi)
    assert machine.tolerances.length == pytest.approx(0.1)
    assert machine.tolerances.angle == math.pi / 2
    (mass,) = machine.masses.values()
    assert mass.com == (0.0, 12.0, 60.0)
    (effect,) = machine.effects
    assert effect.place == ("q2",)
    assert effect.value("c", "rad/(N*m)") == pytest.approx(2.1e-7)
    assert effect.std_of("c", "rad/(N*m)") == pytest.approx(1e-8)
    assert effect.value("k", "1") == 3.0
    assert effect.std_of("k", "1") is None
    assert effect.settings == {"order": 2}


@pytest.mark.parametrize(
    ("parameter", "unit", "expected"),
    [
        ("leg3.a.x", "mm", 0.1),
        ("leg3.a.z", "mm", 0.0),
        ("leg4.a.z", "mm", 0.4),
        ("leg5.a.y", "mm", None),
        ("leg5.a.x", "mm", 9.0),
        ("leg1.gain", "mm/turn", 0.5),
        ("leg2.gain", "mm/turn", 0.7),
        ("leg1.u.x", "1", math.radians(0.2)),
        ("leg2.u.y", "1", math.radians(0.3)),
        ("tool.y", "mm", 2.0),
        ("tool.rz", "rad", math.radians(3)),
        ("base.rx", "rad", None),
        ("q4.alpha", "rad", math.radians(0.6)),
        ("q4.theta", "rad", math.inf),
        ("q4.r", "mm", None),
    ],
)
def test_overrides_resolve_from_special_to_general(
    tmp_path: Path, parameter: str, unit: str, expected: float | None
) -> None:
    machine = _read(
        tmp_path,
        BASIC.replace("angle: deg}", "angle: deg, joint: turn}")
        + """\
tolerances:
  length: 1
  leg3.a: [0.1, 0.2, 0]
  leg4.a: 0.4
  leg5.a.x: 9
  gain: 0.5
  leg2.gain: 0.7
  u.x: 0.2
  leg2.u: [0, 0.3, 0]
  tool: 2
  tool.rpy: [1, 2, 3]
  alpha: 0.6
  q4.theta: .inf
""",
    )
    value = machine.override_for(parameter, unit)
    assert value == (None if expected is None else pytest.approx(expected))


def test_overrides_that_fit_nothing_are_found(tmp_path: Path) -> None:
    machine = _read(tmp_path, BASIC + "tolerances: {leg3.a: [1, 1, 1], leg3.lenght: 2}\n")
    names = ["leg3.a.x", "leg3.a.y", "leg3.a.z", "leg3.length"]
    with pytest.raises(InputError, match=r"tolerances\.leg3\.lenght: .*'leg3\.length'"):
        machine.tolerances.check(names)
    assert machine.tolerances.check([*names, "leg3.lenght"]) is None  # type: ignore[func-returns-value]


REFUSED = {
    "schema": (BASIC.replace("machine/1", "machine/2"), "schema: found 'truepose/machine/2'"),
    "no schema": (BASIC.replace("schema: truepose/machine/1\n", ""), "schema: found None"),
    "no name": (BASIC.replace("name: rig\n", ""), "name: missing"),
    "no mechanism": (BASIC.replace("mechanism:", "# mechanism:"), "mechanism: missing"),
    "no type": (BASIC.replace("type: serial, ", ""), "mechanism: expected a field 'type'"),
    "unknown unit": (BASIC.replace("length: mm", "length: mmm"), "units.length: unknown unit 'mmm'"),
    "wrong dimension": (BASIC.replace("angle: deg", "angle: mm"), "units.angle: unit 'mm' is a length"),
    "unknown unit field": (BASIC.replace("angle: deg", "angel: deg"), "units.angel: unknown field; did you"),
    "joint unit": (BASIC.replace("angle: deg", "joint: kg"), "units.joint: unit 'kg' is a mass"),
    "unknown field": (BASIC + "tolerence: {}\n", "tolerence: unknown field; did you mean 'tolerances'"),
    "unknown frame": (BASIC + "frames: {tol: {}}\n", "frames.tol: unknown field; did you mean 'tool'"),
    "short vector": (BASIC + "frames: {base: {xyz: [1, 2]}}\n", "frames.base.xyz: expected 3 finite numbers"),
    "nan": (BASIC + "frames: {base: {rpy: [.nan, 0, 0]}}\n", "frames.base.rpy: expected 3 finite"),
    "infinite": (BASIC + "frames: {base: {rpy: [.inf, 0, 0]}}\n", "frames.base.rpy: expected 3 finite"),
    "negative tolerance": (BASIC + "tolerances: {length: -1}\n", "tolerances.length: expected a number >= 0"),
    "negative override": (BASIC + "tolerances: {gain: -1}\n", "tolerances.gain: expected a number >= 0"),
    "one negative of several": (
        BASIC + "tolerances: {leg3.a: [1, -1, 1]}\n",
        "tolerances.leg3.a: expected a number >= 0",
    ),
    "text tolerance": (BASIC + "tolerances: {angle: small}\n", "tolerances.angle: expected a number >= 0"),
    "mass": (BASIC + "masses: {m: {kg: -1, in: tool}}\n", "masses.m.kg: "),
    "mass frame": (BASIC + "masses: {m: {kg: 1}}\n", "masses.m.in: missing field"),
    "gravity": (BASIC + "gravity: 9.81\n", "gravity: expected 3 finite numbers"),
    "sensor": (BASIC.replace("sensor: {type: pose,", "sensor: {"), "sensor: expected a field 'type'"),
    "sensors": (
        BASIC.replace("sensor: {type: pose,", "sensor: [{").replace("001}}", "001}}]"),
        "sensor[0]: exp",
    ),
    "drivers": (BASIC + "drivers: payload\n", "drivers: expected a list"),
    "effects": (BASIC + "effects: [{place: [q1]}]\n", "effects[0].effect: missing field"),
    "effect field": (BASIC + "effects: [{effect: a, plase: [q1]}]\n", "effects[0].plase: unknown field"),
    "effect value": (
        BASIC + "effects: [{effect: a, place: [q], parameters: {c: {value: x}}}]\n",
        "effects[0].parameters.c.value: expected a finite number",
    ),
    "effect unit": (
        BASIC + "effects: [{effect: a, place: [q], parameters: {c: {value: 1, unit: nope}}}]\n",
        "effects[0].parameters.c.unit: unknown unit 'nope'",
    ),
    "effect settings": (
        BASIC + "effects: [{effect: a, place: [q], settings: {order: 1}}]\n",
        "effects[0].settings: found {'order': 1}, expected a number: a setting stands beside effect and place",
    ),
    "effect coefficients": (
        BASIC + "effects: [{effect: a, place: [q], coefficients: {c: 1}}]\n",
        "coefficients stand in parameters",
    ),
    "duplicate key": (BASIC + "name: again\n", "line 6: duplicate key 'name'"),
    "nested duplicate": (BASIC + "frames: {base: {xyz: [0,0,0], xyz: [1,1,1]}}\n", "duplicate key 'xyz'"),
    "key": (BASIC + "masses: {1: {kg: 1, in: tool}}\n", "field name '1' is read as int"),
    "syntax": (BASIC + "frames: [\n", "line"),
    "unsafe tag": (BASIC + "covariance: !!python/object/apply:os.getcwd []\n", "python/object/apply"),
    "own alias": (BASIC + "covariance: &a {b: *a}\n", "an alias contains itself"),
    "no mapping": ("- 1\n", "expected a mapping"),
    "empty": ("", "expected a mapping"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_refusals_name_file_and_field(tmp_path: Path, case: str) -> None:
    text, expected = REFUSED[case]
    assert expected in _refusal(tmp_path, text)


def test_an_effects_unit_must_fit(tmp_path: Path) -> None:
    entry = "effects: [{effect: a, place: q2, parameters: {c: {value: 1, unit: mm/N}}}]\n"
    (effect,) = _read(tmp_path, BASIC + entry).effects
    with pytest.raises(InputError, match=r"machine\.yaml: effects\[0\]\.parameters\.c: unit 'mm/N'"):
        effect.value("c", "rad/(N*m)")
    with pytest.raises(InputError, match=r"effects\[0\]\.parameters: missing 'd'"):
        effect.value("d", "1")


def test_a_bomb_of_aliases_is_refused(tmp_path: Path) -> None:
    lines = ["covariance:", "  a0: &a0 [1, 1, 1, 1, 1, 1, 1, 1, 1, 1]"]
    lines += [f"  a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 10)}]" for k in range(1, 12)]
    assert "too large" in _refusal(tmp_path, BASIC + "\n".join(lines) + "\n")


@pytest.mark.parametrize("content", [None, b"\xff\xfe\x00"])
def test_unreadable_files_are_refused(tmp_path: Path, content: bytes | None) -> None:
    path = tmp_path / "machine.yaml"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(InputError, match="cannot read the file"):
        read_machine(path)
    with pytest.raises(InputError, match="cannot read the file"):
        read_machine(tmp_path)


plain = (
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats(allow_nan=False)
    | st.text(string.printable + "äµ°\u2028", max_size=12)
)
texts_like_numbers = st.sampled_from(["1e-4", "1.", ".5", "-3", "on", "null", "0x1f", ".inf", "~", "1_0"])
documents = st.dictionaries(
    st.text("abcdefgxyz.0123", min_size=1, max_size=8),
    st.recursive(plain | texts_like_numbers, lambda inner: st.lists(inner, max_size=4), max_leaves=12),
    max_size=6,
)


@given(documents)
def test_documents_read_back_as_written(tmp_path_factory: pytest.TempPathFactory, document: Any) -> None:
    path = tmp_path_factory.mktemp("yaml") / "document.yaml"
    write_machine(path, document)
    back = read_document(path)
    assert back == document
    assert list(back) == list(document)
    assert repr(back) == repr(document)


@pytest.mark.parametrize("file", sorted(ROOT.glob("*/machines/**/*.yaml")), ids=lambda path: path.stem)
def test_both_loaders_read_the_same(file: Path) -> None:
    """That in C and that in Python, which reads what C refuses."""
    text = file.read_text(encoding="utf-8")
    assert repr(yaml.load(text, FastLoader)) == repr(yaml.load(text, PlainLoader))


def test_what_c_refuses_is_told_as_python_tells_it(tmp_path: Path) -> None:
    (tmp_path / "bad.yaml").write_text("schema: x\nsensor: {type: pose, sigma: [1, 2}\n")
    with pytest.raises(yaml.YAMLError) as refused:
        yaml.load((tmp_path / "bad.yaml").read_text(), PlainLoader)
    with pytest.raises(InputError, match=re.escape(str(refused.value.problem))):  # type: ignore[attr-defined]
        read_document(tmp_path / "bad.yaml")


def test_written_files_are_short_and_exact() -> None:
    text = document_text(
        {"b": np.array([0.1, 1e-9]), "a": {"xyz": (1, 2.5, math.inf)}, "c": np.float64(1 / 3)}
    )
    assert text == "b: [0.1, 1.0e-09]\na:\n  xyz: [1, 2.5, .inf]\nc: 0.3333333333333333\n"


def test_machine_files_at_hand_are_accepted_and_write_back(shared: Path, tmp_path: Path) -> None:
    paths = sorted(shared.glob("*/*/machine*.yaml"))
    assert paths
    for path in paths:
        machine = read_machine(path)
        write_machine(tmp_path / "copy.yaml", machine.raw)
        assert read_machine(tmp_path / "copy.yaml").raw == machine.raw, path


def _fill(path: Path, fail: bool) -> None:
    with atomic_directory(path) as partial:
        (partial / "a.txt").write_text("new")
        (partial / "sub").mkdir()
        (partial / "sub" / "b.txt").write_text("new")
        if fail:
            raise RuntimeError("stopped")


@pytest.mark.parametrize("exists", [False, True])
def test_a_directory_is_filled_whole_or_not_at_all(tmp_path: Path, exists: bool) -> None:
    target = tmp_path / "deep" / "out"
    if exists:
        target.mkdir(parents=True)
        (target / "a.txt").write_text("old")
        (target / "kept.txt").write_text("kept")
    before = sorted(tmp_path.rglob("*"))
    with pytest.raises(RuntimeError, match="stopped"):
        _fill(target, fail=True)
    assert sorted(tmp_path.rglob("*")) == before
    _fill(target, fail=False)
    assert (target / "a.txt").read_text() == (target / "sub" / "b.txt").read_text() == "new"
    assert (target / "kept.txt").exists() == exists
    assert [path.name for path in target.parent.iterdir()] == ["out"]


def test_a_text_is_written_whole_or_not_at_all(tmp_path: Path) -> None:
    target = tmp_path / "result.txt"
    atomic_write_text(target, "old")
    with pytest.raises(UnicodeEncodeError):
        atomic_write_text(target, "new \ud800")
    assert target.read_text() == "old"
    with pytest.raises(InputError, match="cannot write"):
        atomic_write_text(tmp_path / "nowhere" / "x.txt", "text")
    assert list(tmp_path.iterdir()) == [target]
