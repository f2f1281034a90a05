"""Laws of an older calibration met again: accuracy that is enough, noise that is not as stated, what is hidden, companions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from support import MACHINES
from support.drifting_arm import HOUR, SIGMA, TURN_SIGMA, machine_text, write_sequence
from support.stacked_sessions import distance_rows
from truepose.arrays import Array, Mask
from truepose.identification.fit.estimate import estimate
from truepose.identification.fit.estimated import Estimate
from truepose.identification.fit.problem import Prior, Problem, prior_of
from truepose.identification.fit.summary import rms_by_kind
from truepose.identification.leaves.drift.sessions import Session, bounded, sessions_of
from truepose.identification.leaves.drift.sizes import Check, durability, fit_when_met, noise_of
from truepose.identification.prediction.predict import predict
from truepose.identification.recording.load import load_recording
from truepose.models.load import load_machine


@dataclass(frozen=True)
class Met:
    """Two sessions of an arm, each with its own fit."""

    sessions: tuple[Session, ...]
    fits: tuple[Estimate, ...]
    prior: Prior

    def checks(self, accuracy: Mapping[str, float] | None = None) -> tuple[Check, Check]:
        """The second session with all of the first calibration, and with frames re-identified."""
        names = [self.prior.names[k] for k in self.prior.free]
        frames = np.array([name.split(".")[0] in ("base", "tool") for name in names])
        found = durability(self.sessions, self.fits, self.prior, frames, accuracy)
        (carried,), (anew,) = found.carried, found.frames
        assert carried is not None and anew is not None
        return carried, anew


def met(folder: Path, moves: Mapping[str, list[float]], share: float = 1.0) -> Met:
    """An hour apart, with ``share`` of the true sigma stated."""
    path, files = write_sequence(folder, 92, moves, sessions=2, every=HOUR, n=12)
    stated = f"xyz: {SIGMA!r}, rot: {TURN_SIGMA}"
    assert stated in machine_text()
    path.write_text(
        machine_text().replace(stated, f"xyz: {share * SIGMA}, rot: {share * TURN_SIGMA}"), encoding="utf-8"
    )
    machine = load_machine(path)
    prior = prior_of(machine)
    sessions, _ = sessions_of(machine, load_recording(machine, files))
    fits = [estimate(machine, s.recording, prior=bounded(prior), predictor=s.predictor) for s in sessions]
    return Met(sessions, tuple(fits), prior)


@pytest.fixture(scope="module")
def moved(tmp_path_factory: pytest.TempPathFactory) -> Met:
    return met(tmp_path_factory.mktemp("moved"), {"q4.d": [0.0, 0.3]})


@pytest.fixture(scope="module")
def distances(tmp_path_factory: pytest.TempPathFactory) -> Met:
    """Changes of a distance, the first of each session since itself; nothing moved."""
    folder, n, rng = tmp_path_factory.mktemp("distances"), 120, np.random.default_rng(12)
    machine = load_machine(MACHINES / "distance.yaml")
    rows, origin = distance_rows(n, 2, rng)
    rows.to_csv(folder / "rows.csv", index=False)
    prior = prior_of(machine)
    nominal = predict(machine, load_recording(machine, [folder / "rows.csv"]))["dL"].to_numpy()
    shake = 1e-5 * rng.standard_normal(n) * (origin != np.arange(n))
    rows.assign(dL=nominal + shake).to_csv(folder / "rows.csv", index=False)
    sessions, _ = sessions_of(machine, load_recording(machine, [folder / "rows.csv"]))
    fits = [estimate(machine, s.recording, prior=bounded(prior), predictor=s.predictor) for s in sessions]
    return Met(sessions, tuple(fits), prior)


@pytest.fixture(scope="module")
def still(tmp_path_factory: pytest.TempPathFactory) -> Met:
    return met(tmp_path_factory.mktemp("still"), {})


def test_what_moved_does_not_hold_unless_it_is_accurate_enough(moved: Met, still: Met) -> None:
    """Accuracy counts by kind, and a kind that is not asked for is good enough; what holds anyway goes on holding."""
    carried, anew = moved.checks()
    assert not carried.holds and not anew.holds and carried.p < 1e-6
    for check, k in ((carried, 0), (anew, 1)):
        position, rotation = check.rms["position"], check.rms["rotation"]
        for enough, holds in (
            ({"position": 1.01 * position, "rotation": 1.01 * rotation}, True),
            ({"position": 1.01 * position}, True),
            ({"position": 0.99 * position, "rotation": 9.0}, False),
            ({"position": 9.0, "rotation": 0.99 * rotation}, False),
        ):
            again = moved.checks(enough)[k]
            assert again.holds is holds
            assert (again.p, again.rms, again.expected) == (check.p, check.rms, check.expected)
    assert all(check.holds for check in (*still.checks(), *still.checks({"position": 1e-9})))


def test_what_did_not_move_is_as_expected_whatever_sigma_is_stated(still: Met, tmp_path: Path) -> None:
    """p of no movement is no small one; with a quarter of the true sigma stated it is the same."""
    wrong = met(tmp_path / "wrong", {}, share=0.25)
    assert noise_of(wrong.fits)[0] == pytest.approx(4.0 * noise_of(still.fits)[0], rel=0.05)
    assert noise_of(still.fits)[1] == sum(f.n_observations - f.rank for f in still.fits)
    for right, other in zip(still.checks(), wrong.checks(), strict=True):
        assert 0.01 < right.p < 0.99  # one draw
        assert other.p == pytest.approx(right.p, abs=0.05)
        for kind in ("position", "rotation"):
            assert right.rms[kind] == pytest.approx(right.expected[kind], rel=0.25)
            assert other.expected[kind] == pytest.approx(right.expected[kind], rel=0.1)


def test_few_readings_leave_the_noise_as_stated(still: Met) -> None:
    """Below ten degrees of freedom nothing is read from them; and noise is at least 0.8 of what is stated."""
    one = still.fits[0]
    assert noise_of([replace(one, levels=one.n_observations - one.rank - 9)]) == (1.0, np.inf)
    assert noise_of([replace(one, levels=one.n_observations - one.rank - 10)])[1] == 10.0
    quiet = replace(one, factor=one.factor * np.append(np.ones(one.factor.shape[1] - 1), 1e-3))
    assert noise_of([quiet])[0] == 0.8


def by_rows(session: Session, fit: Estimate) -> tuple[Array, Array]:
    """Jacobian (m, n) and residual (m,) of every reading of a session at a fit's parameters, in stated sigmas."""
    problem = Problem(session.predictor, bounded(fit.prior), fit.p, ~session.recording.validation)
    rows = np.concatenate(list(problem.data(fit.p, problem.x)))
    return rows[:, :-1], rows[:, -1]


def identified_anew(which: str, names: Sequence[str]) -> Mask:
    frames = np.array([name.split(".")[0] in ("base", "tool", "beam", "mirror") for name in names])
    most = np.array([name not in ("q4.d", "t.beta") for name in names])  # what no other can stand for
    return {"nothing": frames & False, "frames": frames, "all but one": most}[which]


@pytest.mark.parametrize("anew", ["nothing", "frames", "all but one"])
@pytest.mark.parametrize("case", ["moved", "distances"])
def test_a_check_is_that_of_the_gaussian_of_all_readings(
    case: str, anew: str, request: pytest.FixtureRequest
) -> None:
    """Generalised least squares with the covariance of all readings written out: noise, and the first fit's errors."""
    one: Met = request.getfixturevalue(case)
    names = [one.prior.names[k] for k in one.prior.free]
    fresh = identified_anew(anew, names)
    found = durability(one.sessions, one.fits, one.prior, fresh)
    (check,) = found.frames
    noise, freedom = noise_of(one.fits)
    first, own = one.fits
    session = one.sessions[1]
    met_again = fit_when_met(session, one.prior, first.p, fresh)
    assert check is not None and met_again is not None and found.noise == noise
    np.testing.assert_array_equal(met_again.p[one.prior.free[~fresh]], first.p[one.prior.free[~fresh]])

    seen, residual = by_rows(session, met_again)
    known = first.factor[:, :-1].T @ first.factor[:, :-1] / noise**2 + np.diag(first.prior_weight**2)
    carried = np.linalg.inv(known)[np.ix_(~fresh, ~fresh)]
    says = np.any(seen != 0.0, axis=1)  # a change since itself is no reading
    spread = noise**2 * np.diag(says.astype(float)) + seen[:, ~fresh] @ carried @ seen[:, ~fresh].T
    root = np.linalg.inv(np.linalg.cholesky(spread[np.ix_(says, says)]))
    new, far = root @ seen[np.ix_(says, fresh)], root @ residual[says]
    far = far - new @ np.linalg.lstsq(new, far, rcond=1e-10)[0]
    fitted = np.linalg.matrix_rank(new, tol=1e-9 * np.linalg.norm(new)) if fresh.any() else 0
    jacobian, left = by_rows(session, own)
    left = left - jacobian @ np.linalg.lstsq(jacobian, left, rcond=1e-10)[0]
    freed = np.linalg.matrix_rank(jacobian, tol=1e-9 * np.linalg.norm(jacobian)) - fitted
    excess = max(far @ far - left @ left / noise**2, 0.0)
    p = stats.f.sf(excess / freed, freed, freedom)
    assert freed == (1 if anew == "all but one" else own.rank - fitted)
    assert check.p == pytest.approx(p, rel=1e-5)
    assert (check.p < 1e-6) is (case == "moved")

    away = np.eye(len(seen)) - seen[:, fresh] @ np.linalg.pinv(seen[:, fresh], rcond=1e-10)
    spread = np.diag(away @ spread @ away.T)
    shape, channels = met_again.residual[met_again.used].shape, session.predictor.channels
    for values, told in ((residual, check.rms), (np.sqrt(spread), check.expected)):
        for kind, size in rms_by_kind(values.reshape(shape), channels).items():
            assert told[kind] == pytest.approx(size, rel=1e-6)


# -- the joint fit ---------------------------------------------------------------------------------------
