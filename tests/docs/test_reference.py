"""The reference pages and the JSON Schemas are what the code says, and the schemas say what the code does."""

from __future__ import annotations

import copy
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import jsonschema
import pytest
from typer.testing import CliRunner

import recording_columns as columns
import reference_tables
from machine_schema import machine_schema
from recording_columns import RECORDING_SCHEMA, row_schema
from support import MACHINES, ROOT
from truepose.cli import app
from truepose.errors import InputError
from truepose.identification.recording import file
from truepose.identification.recording.load import load_recording
from truepose.models.file.driver import Driver
from truepose.models.file.fields import Section
from truepose.models.file.machine_file import write_machine
from truepose.models.file.names import MACHINE_SCHEMA, SCHEMA_LINE
from truepose.models.file.yaml_document import read_document
from truepose.models.load import load_machine
from truepose.models.machine.builder import builders
from truepose.models.machine.columns import OF_ROWS
from truepose.models.machine.machine import Machine
from truepose.models.machine.sensor import sensors
from truepose.models.schemas import MACHINE, RECORDING, stored

OWN = sorted(MACHINES.glob("*.yaml"))
BUNDLED = sorted((ROOT / "models/machines").glob("*/machine.yaml"))
PAGE, RECORDING_PAGE = (page.read_text(encoding="utf-8") for page in reference_tables.PAGES)
FREE = ("tolerances", "bounds", "home", "limbs")
"""Keys below these are names of the machine, which a schema does not know."""
READER = jsonschema.Draft202012Validator(machine_schema())
ROWS = jsonschema.Draft202012Validator(row_schema())
SERIAL = read_document(MACHINES / "serial.yaml")


def name(path: Path) -> str:
    return path.parent.name if path.stem == "machine" else path.stem


@cache
def loaded(path: Path) -> Machine:
    return load_machine(path)


def sections(above: type[Section] = Section) -> Iterator[type[Section]]:
    for kind in above.__subclasses__():
        if kind.__module__.startswith("truepose."):
            yield kind
        yield from sections(kind)


# --- pages ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("page", reference_tables.PAGES, ids=name)
def test_the_tables_of_a_page_are_what_the_code_says(page: Path) -> None:
    """Run ``python docs/reference_tables.py`` after a field or a column was added or described anew."""
    text = page.read_text(encoding="utf-8")
    assert reference_tables.rendered(text) == text


def test_every_part_has_a_table() -> None:
    assert set(reference_tables.marks(PAGE)) == set(reference_tables.parts())
    groups = {g for g, known in vars(columns).items() if isinstance(known, tuple)} - {"COLUMNS"}
    assert set(reference_tables.marks(RECORDING_PAGE)) == groups
    assert sum(len(getattr(columns, group)) for group in groups) == len(columns.COLUMNS)


def test_every_field_of_every_section_stands_in_the_page_and_says_what_it_is() -> None:
    list(builders), list(sensors)
    found = list(sections())
    assert len(found) > 30
    for section in found:
        for field_name, field in section.model_fields.items():
            key = field.alias or field_name
            assert field.description, f"{section.__name__}.{key}"
            rows = [line for line in PAGE.splitlines() if line.endswith(f"| {field.description} |")]
            assert any(re.match(rf"\| `(\S+\.)?{re.escape(key)}` \|", row) for row in rows), key


def test_every_column_of_the_code_stands_in_the_list_and_none_else(tmp_path: Path) -> None:
    known = {column.name for column in columns.COLUMNS}
    spelled = {f"{kind}.<joint>" for kind in file.OF_JOINTS}
    assert known >= {*file.LOGGED, *OF_ROWS, *spelled, "temperature.<place>"}
    own = {c.name for c in (*columns.ORDER, *columns.LOGGED)} - {"temperature.<place>", "temperature.air"}
    assert own == {*file.LOGGED, *OF_ROWS, *spelled}
    machine = load_machine(MACHINES / "serial.yaml")
    table = {"q1": 1, "q2": 2, "q3": 3, "x": 4, "y": 5, "z": 6}
    for column in (*columns.ORDER, *columns.LOGGED):
        value: object = column.values[0] if column.values else 1
        table[column.name.replace("<joint>", "q2").replace("<place>", "base")] = value  # type: ignore[assignment]
    path = tmp_path / "all.csv"
    path.write_text(f"{','.join(table)}\n{','.join(map(str, table.values()))}\n", encoding="utf-8")
    recording = load_recording(machine, [path])
    assert recording.notes == ()
    assert set(recording.drivers) == {n for n in table if Driver.of(n).unit({"q2": "rad"}) or "." in n} - {
        "time",
        "session",
    }


@pytest.mark.parametrize("kind", sorted(sensors))
def test_the_columns_of_every_sensor_stand_in_the_list(kind: str) -> None:
    listed = [column for column in columns.READINGS if kind in column.sensor]
    assert listed
    sensor = sensors.get(kind, "")
    labels = {*sensor.label_columns, *sensor.optional_labels}
    assert labels == {column.name for column in listed if column.holds == "text"}


def test_the_sensors_of_machine_files_read_what_the_list_has() -> None:
    for path in (*OWN, *BUNDLED):
        for sensor in loaded(path).sensors:
            listed = [column for column in columns.READINGS if sensor.type in column.sensor]
            for column, unit in sensor.columns.items():
                fits = [known for known in listed if re.match(known.pattern, column)]
                assert fits, column
                assert {"length": "mm", "angle": "rad"}[fits[0].unit] == unit


# --- schemas -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", [MACHINE, RECORDING])
def test_the_shipped_schema_is_what_the_code_says(kind: str) -> None:
    """Run ``python docs/reference_tables.py`` after a field or a column was added or described anew."""
    assert stored(kind) == reference_tables.schema_of(kind)
    result = CliRunner().invoke(app, ["schema", kind])
    assert result.exit_code == 0
    assert result.stdout == stored(kind)


def test_the_schemas_are_schemas_and_have_an_address() -> None:
    for schema, address in ((machine_schema(), MACHINE_SCHEMA), (row_schema(), RECORDING_SCHEMA)):
        jsonschema.Draft202012Validator.check_schema(schema)
        assert schema["$id"] == address
    assert MACHINE_SCHEMA in SCHEMA_LINE and SCHEMA_LINE.startswith("# yaml-language-server: $schema=")


def test_every_type_that_is_known_is_in_the_schema() -> None:
    fields = machine_schema()["properties"]
    assert fields["mechanism"]["properties"]["type"]["enum"] == list(builders)
    assert fields["sensor"]["anyOf"][1]["properties"]["type"]["enum"] == list(sensors)


@pytest.mark.parametrize("path", [*OWN, *BUNDLED], ids=name)
def test_a_machine_file_that_loads_is_valid(path: Path, tmp_path: Path) -> None:
    assert loaded(path).name
    READER.validate(read_document(path))
    write_machine(tmp_path / "copy.yaml", read_document(path))
    written = (tmp_path / "copy.yaml").read_text(encoding="utf-8")
    assert written.startswith(f"{SCHEMA_LINE}\n")


@pytest.mark.parametrize("path", BUNDLED, ids=name)
def test_a_bundled_file_names_its_schema_first(path: Path) -> None:
    assert path.read_text(encoding="utf-8").splitlines()[0] == SCHEMA_LINE


def renamed(document: Any, at: tuple[Any, ...], key: str, new: str) -> Any:
    """The document with one key called otherwise."""
    changed = copy.deepcopy(document)
    here = changed
    for part in at:
        here = here[part]
    here[new] = here.pop(key)
    return changed


def keys(document: Any, at: tuple[Any, ...] = ()) -> Iterator[tuple[tuple[Any, ...], str]]:
    """Every key of every mapping, one of each list's entries standing for all."""
    if isinstance(document, dict):
        for key, value in document.items():
            yield at, key
            yield from keys(value, (*at, key))
    elif isinstance(document, list) and document:
        yield from keys(document[0], (*at, 0))


@pytest.mark.parametrize("path", [path for path in OWN if path.stem != "delta"], ids=name)
def test_a_key_with_a_typo_is_refused_by_both_or_by_none(path: Path, tmp_path: Path) -> None:
    document = read_document(path)
    for at, key in keys(document):
        wrong = renamed(document, at, key, f"{key}x")
        valid = READER.is_valid(wrong)
        write_machine(tmp_path / "typo.yaml", wrong)
        try:
            load_machine(tmp_path / "typo.yaml")
        except InputError:
            own = at == (
                "frames",
            )  # a frame of any name may be the user's; a schema does not know whether one is read
            assert not valid or own or any(part in FREE for part in at) or "points" in at, (*at, key)
        else:
            assert valid, (*at, key)


WRONG: dict[str, Any] = {
    "schema": {"schema": "truepose/machine/2"},
    "a key that is none": {"tolerence": {"length": 0.1}},
    "an empty name": {"name": ""},
    "two numbers of three": {"gravity": [0, -9.81]},
    "a text for a number": {"gravity": [0, 0, "down"]},
    "a sensor that is none": {"sensor": {"type": "positon", "sigma": {"xyz": 0.01}}},
    "a sensor without sigma": {"sensor": {"type": "position"}},
    "a sigma of nothing": {"sensor": {"type": "position", "sigma": {"xyz": 0}}},
    "a list with a wrong sensor": {"sensor": [{"type": "position", "sigma": {"xyz": 1, "rot": 1}}]},
    "a mechanism that is none": {"mechanism": {"type": "seriel", "joints": []}},
    "a kind that is none": {"mechanism": {"type": "serial", "joints": [{"name": "q", "kind": "revolut"}]}},
    "a joint without a name": {"mechanism": {"type": "serial", "joints": [{"kind": "revolute"}]}},
    "a modified table's beta": {
        "mechanism": {
            "type": "serial",
            "convention": "modified",
            "joints": [{"name": "q", "kind": "revolute", "beta": 1}],
        }
    },
    "a negative tolerance": {"tolerances": {"length": -0.1}},
    "a mass without a body": {"masses": {"m": {"kg": 1}}},
    "a negative mass": {"masses": {"m": {"kg": -1, "in": "tool"}}},
    "an effect that is none": {"effects": [{"effect": "backlsh", "place": ["q2"]}]},
    "an effect without a place": {"effects": [{"effect": "backlash"}]},
    "a frame that is none": {"frames": {"flange": {"xyz": [0, 0, 1]}}},
    "bounds of one number": {"bounds": {"q2.d": [1]}},
    "a unit that is none": {"sensor": {"type": "position", "sigma": {"xyz": "um"}}},
    "a standard row without its convention": {
        "mechanism": {"type": "serial", "joints": [{"name": "q", "kind": "revolute", "a": 1}]}
    },
}


@pytest.mark.parametrize("wrong", WRONG.values(), ids=WRONG)
def test_a_mistake_is_refused_by_schema_and_code(wrong: dict[str, Any], tmp_path: Path) -> None:
    document = {**SERIAL, **wrong}
    assert READER.is_valid(SERIAL) and not READER.is_valid(document)
    write_machine(tmp_path / "wrong.yaml", document)
    with pytest.raises(InputError):
        load_machine(tmp_path / "wrong.yaml")


def test_a_row_is_checked_by_the_names_of_its_columns() -> None:
    row: dict[str, Any] = {"q1": 1.0, "x [um]": 2.0, "temperature.base": 20.5, "role": "validation"}
    row |= {"approach.q1": -1, "session": 3, "P1.x": None, "note": "windy"}
    ROWS.validate(row)
    for key, value in (
        ("x [um]", "far"), ("temperature.base", None), ("role", "test"), ("approach.q1", 2), ("session", 1.5)
    ):  # fmt: skip
        assert not ROWS.is_valid({**row, key: value}), key


@pytest.mark.parametrize("arm", ["kr6", "gough", "telescope-mount"])
def test_what_init_writes_is_valid(arm: str, tmp_path: Path) -> None:
    made = CliRunner().invoke(app, ["init", "--arm", arm, "-o", str(tmp_path / "own.yaml")])
    assert made.exit_code == 0, made.output
    READER.validate(read_document(tmp_path / "own.yaml"))
    assert (tmp_path / "own.yaml").read_text(encoding="utf-8").startswith(f"{SCHEMA_LINE}\n")
