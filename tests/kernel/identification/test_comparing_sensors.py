"""A sensor that compares rows beside one that reads each row by itself: what is said of the first stays as it was alone.

The nanopositioner's length has a tracker beside it that is blind: its sigma is a thousand kilometres.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

import truepose.models
from support.effects import with_effect
from support.exact_fits import fit_at, read
from truepose.identification.diagnosis.null_fits import outlying_rows
from truepose.identification.fit.estimate import estimate
from truepose.identification.fit.estimated import Estimate
from truepose.identification.recording.load import load_recording
from truepose.identification.recording.recording import Recording
from truepose.identification.report.partial_residuals import port_shifts
from truepose.identification.signatures.signatures import Signatures
from truepose.models.load import load_machine
from truepose.models.machine.machine import Machine

Seen = tuple[Machine, Recording]
NANOPOSITIONER = Path(truepose.models.__path__[0]) / "machines" / "nanopositioner"
BLIND = {"type": "position", "name": "blind", "sigma": {"xyz": 1e9}}


@pytest.fixture(scope="module")
def seen(tmp_path_factory: pytest.TempPathFactory) -> Mapping[str, Seen]:
    """The machine with the length alone, and with the tracker before it and behind it; the recording that comes with it."""
    folder = tmp_path_factory.mktemp("comparing")
    document = yaml.safe_load((NANOPOSITIONER / "machine.yaml").read_text(encoding="utf-8"))
    length = document["sensor"]
    out = dict[str, Seen]()
    for name, sensors in {"alone": [length], "first": [BLIND, length], "last": [length, BLIND]}.items():
        (folder / f"{name}.yaml").write_text(yaml.safe_dump(document | {"sensor": sensors}), encoding="utf-8")
        machine = load_machine(folder / f"{name}.yaml")
        alone = out["alone"][0] if out else machine
        recording = load_recording(alone, NANOPOSITIONER / "recording.csv")
        blind = {} if name == "alone" else {f"blind.{axis}": np.zeros(len(recording)) for axis in "xyz"}
        out[name] = machine, replace(recording, observations={**recording.observations, **blind})
    return out


def test_a_fit_is_the_same(seen: Mapping[str, Seen]) -> None:
    """Also without the row that others are compared with: they need its pose all the same."""
    _, recording = seen["alone"]
    assert recording.from_row is not None
    out = np.arange(len(recording)) == recording.from_row[-1]
    alone, both = (estimate(*seen[name], exclude=out) for name in ("alone", "first"))
    at = [list(both.prior.names).index(name) for name in alone.prior.names]
    np.testing.assert_allclose(both.p[at], alone.p, rtol=1e-6, atol=1e-9)


@pytest.fixture(scope="module")
def bent(seen: Mapping[str, Seen]) -> Mapping[str, tuple[Estimate, Recording]]:
    """Exact readings of a machine whose second slide has another scale, and fits that stand at the truth."""
    out = dict[str, tuple[Estimate, Recording]]()
    for name, (machine, whole) in seen.items():
        term = with_effect(machine, "actuator-scale", ("q2",), None, s=1e-3)
        recording = read(machine, whole, [term])
        out[name] = fit_at(machine, recording, [term]), recording
    return out


@pytest.mark.parametrize("beside", ["first", "last"])
def test_each_row_says_the_same_of_an_effect(
    bent: Mapping[str, tuple[Estimate, Recording]], beside: str
) -> None:
    said = []
    for name in ("alone", beside):
        fit, recording = bent[name]
        ((shift,),) = port_shifts(fit, recording, [fit.effects])
        said.append(shift)
    one, two = said
    assert np.isfinite(one.rows).sum() > 60
    np.testing.assert_allclose(two.rows, one.rows, rtol=1e-9)
    np.testing.assert_allclose(two.std, one.std, rtol=1e-6)


@pytest.mark.parametrize("beside", ["first", "last"])
def test_the_same_row_is_gross(bent: Mapping[str, tuple[Estimate, Recording]], beside: str) -> None:
    """A row's own share in its prediction is asked only where it stands for itself."""
    found = []
    for name in ("alone", beside):
        fit, recording = bent[name]
        residual = np.random.default_rng(1).standard_normal(len(recording))
        residual[40] = 30.0
        channels = np.zeros_like(fit.residual)
        channels[:, [c.kind for c in fit.nominal.channels].index("distance")] = residual
        every = np.ones(len(recording), dtype=bool)
        found.append(outlying_rows(replace(fit, residual=channels), recording, every))
    assert np.flatnonzero(found[0]).tolist() == [40]
    assert np.flatnonzero(found[1]).tolist() == [40]


def test_sums_over_rows_are_the_same(bent: Mapping[str, tuple[Estimate, Recording]]) -> None:
    grams = []
    for name in ("alone", "last"):
        fit, recording = bent[name]
        signatures = Signatures(fit.nominal, recording, fit.effects)
        assert not signatures.by_row
        lin = signatures.linearise(fit)
        kinds = list(dict.fromkeys(channel.kind for channel in fit.nominal.channels))
        grams.append(lin.grams[kinds.index("distance")])
    size = np.sqrt(np.diag(grams[0]))
    np.testing.assert_allclose(grams[1], grams[0], atol=1e-9 * float(np.max(np.outer(size, size))))
