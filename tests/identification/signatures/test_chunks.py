"""Sums over chunks of rows: the same digits on cores and on a Dask cluster, and chunks that know what the whole knows."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from support.tiny_fleets import GAIN, PLAY, rows
from support.tiny_machine import Tiny
from truepose import load_machine, load_recording
from truepose.errors import InputError
from truepose.identification.fit.estimate import estimate
from truepose.identification.recording.recording import Recording
from truepose.identification.signatures import chunks
from truepose.identification.signatures.candidates import catalogue
from truepose.identification.signatures.linearisation import Linearisation
from truepose.identification.signatures.signatures import Signatures
from truepose.models.machine.machine import Machine
from truepose.models.registry import load_plugin
from truepose.pool import Cluster, cluster, present, rows_on

PLUGIN = """
from truepose.models.effects.common import Coefficient, Effect, effects

@effects.add("of-a-plugin")
class OfAPlugin(Effect):
    slug = "of-a-plugin"
    title = "Turns with the square of a joint"

    def places(self, machine):
        return [("q1",)]

    def coefficients(self, machine, place, settings):
        return (Coefficient("s", "rad", 1e-3),)

    def shifts(self, site):
        (joint,) = site.place
        return {f"{joint}.displacement": site.c["s"] * site.q[joint] ** 2}
"""
REMEMBERED = ("stop.q1~0.01", "loop.q2~0.01~-1~1", "approach.q2", "temperature.air~300", "creep.q1~60", "row")


@pytest.fixture(scope="module")
def machine(tmp_path_factory: pytest.TempPathFactory) -> Machine:
    file = tmp_path_factory.mktemp("tiny") / "machine.yaml"
    file.write_text(Tiny().machine_text())
    return load_machine(file)


@pytest.fixture(scope="module")
def recording(machine: Machine) -> Recording:
    """Rows with a clock, a temperature, two sessions, some lost readings, and sides that only their order tells."""
    frame = rows(5, [GAIN, PLAY], 80).drop(columns=["approach.q2"])
    frame["time"], frame["temperature.air"] = 30.0 * np.arange(len(frame)), 20.05 + np.arange(len(frame)) % 7
    frame["session"] = np.where(np.arange(len(frame)) < 30, 1, 2)
    frame.loc[[3, 50], "x"] = np.nan
    return load_recording(machine, frame)


@pytest.fixture(scope="module")
def dask() -> Iterator[Cluster]:
    distributed = pytest.importorskip("distributed")
    with (
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, dashboard_address=None, silence_logs=50
        ) as local,
        cluster(local.scheduler_address) as found,
    ):
        yield found


def drawn(signatures: Signatures, plain: bool = False) -> list[Linearisation]:
    """At a fit with an effect, whose errors of form are columns, too: the whole, and each half."""
    fit = estimate(signatures.machine, signatures.recording, [] if plain else [signatures.candidates[0]])
    whole, halves = signatures.halved(fit)
    return [signatures.linearise(fit), whole, *halves]


def alike(some: list[Linearisation], others: list[Linearisation]) -> bool:
    """Digit by digit."""
    pairs = list(
        itertools.chain.from_iterable(
            zip(a.grams, b.grams, strict=True) for a, b in zip(some, others, strict=True)
        )
    )
    counts = [a.counts == b.counts for a, b in zip(some, others, strict=True)]
    return bool(pairs) and all(np.array_equal(a, b) for a, b in pairs) and all(counts)


def test_a_cluster_gives_the_same_digits(
    machine: Machine, recording: Recording, dask: Cluster, monkeypatch: pytest.MonkeyPatch
) -> None:
    signatures = Signatures(machine, recording, catalogue(machine, recording).candidates)
    drivers = {name.split(".")[0] for c in signatures.candidates for name in c.drivers}
    assert {"stop", "temperature", "approach", "session"} <= drivers  # what a chunk alone could not tell
    monkeypatch.setattr(chunks, "CHUNK", 17)
    here = drawn(signatures)
    with rows_on(dask.client.scheduler.address):
        assert present() is not None
        there = drawn(signatures)
    assert present() is None
    assert alike(here, there)


def test_chunks_add_up_to_the_whole(
    machine: Machine, recording: Recording, monkeypatch: pytest.MonkeyPatch
) -> None:
    signatures = Signatures(machine, recording, catalogue(machine, recording).candidates)
    whole = drawn(signatures)
    monkeypatch.setattr(chunks, "CHUNK", 23)
    for one, sum_ in zip(whole, drawn(signatures), strict=True):
        assert one.counts == sum_.counts
        for gram, other in zip(one.grams, sum_.grams, strict=True):
            size = np.sqrt(np.diag(gram))
            assert np.all(
                np.abs(gram - other) <= 1e-12 * np.outer(size, size)
            )  # rounding of some hundred terms


def test_workers_load_the_plugins_that_candidates_are_of(
    machine: Machine, recording: Recording, dask: Cluster, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from truepose.models.effects.base import PlacedEffect, effects

    (tmp_path / "own.py").write_text(PLUGIN)
    load_plugin(tmp_path / "own.py")
    effect = effects.get("of-a-plugin", "here")()
    signatures = Signatures(machine, recording, [PlacedEffect.at(effect, machine, ("q1",), {})])
    monkeypatch.setattr(chunks, "CHUNK", 50)
    here = drawn(signatures)
    with rows_on(dask.client.scheduler.address):
        assert alike(here, drawn(signatures))


def test_tasks_of_any_size_are_sent_without_a_warning(
    machine: Machine, recording: Recording, dask: Cluster, monkeypatch: pytest.MonkeyPatch
) -> None:
    import dask as settings

    monkeypatch.setattr(chunks, "CHUNK", 50)
    low = {"distributed.admin.large-graph-warning-threshold": "1 kB"}
    with settings.config.set(low), rows_on(dask.client.scheduler.address):
        drawn(Signatures(machine, recording, ()), plain=True)


def test_a_worker_that_dies_twice_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(chunks, "CHUNK", 100)
    with pytest.raises(InputError, match="rows 101 to 200 of those fitted"):
        list(chunks.in_turn(iter([(0, ((), [])), (1, None)])))


@given(st.permutations(range(8)))
def test_results_are_added_in_their_order(order: list[int]) -> None:
    found = chunks.in_turn((k, ((np.array([float(k)]),), [k])) for k in order)
    assert [counts for _, counts in found] == [[k] for k in range(8)]


@given(st.lists(st.integers(0, 79), min_size=1, max_size=30))
def test_rows_alone_keep_what_their_order_told(
    machine: Machine, recording: Recording, some: list[int]
) -> None:
    names = (*REMEMBERED, "session.after.1", "temperature.air", "time", "stop.q9~1")
    part, alone = recording.subset(some), recording.alone(some, names)
    assert alone.whole is alone and len(alone) == len(some)
    for name in names:
        told, kept = part.driver(name), alone.driver(name)
        assert (told is None) == (kept is None)
        assert told is None or kept is None or np.array_equal(told, kept)


def test_the_command_writes_the_same_files(
    dask: Cluster, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from typer.testing import CliRunner

    from truepose.cli import app

    monkeypatch.setattr(chunks, "CHUNK", 20)
    (tmp_path / "machine.yaml").write_text(Tiny().machine_text())
    rows(1, [GAIN], 24).to_csv(tmp_path / "recording.csv", index=False)
    command = ["diagnose", str(tmp_path / "machine.yaml"), str(tmp_path / "recording.csv"), "-o"]
    for name, more in (("cores", []), ("cluster", ["--dask", dask.client.scheduler.address])):
        done = CliRunner().invoke(app, [*command, str(tmp_path / name), *more])
        assert done.exit_code == 0, done.output
    for file in ("diagnosis.json", "improved.yaml"):
        assert (tmp_path / "cores" / file).read_bytes() == (tmp_path / "cluster" / file).read_bytes()
