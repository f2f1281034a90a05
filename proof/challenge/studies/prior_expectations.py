"""What the posteriors of simulated machines say of the prior numbers that were chosen: one step of empirical Bayes.

    python -m challenge.studies.prior_expectations DRAWN [DRAWN ...]

DRAWN are folders of ``python -m challenge --draw`` or ``python -m challenge.mujoco``, with development seeds. Each
case is diagnosed; no key is read. What ``identification.prior`` says of machines stands beside its expectation under the
posteriors, averaged over the cases. Where both differ little, the prior says of such machines what these machines say
themselves.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from joblib import Parallel, delayed
from numpy.typing import NDArray
from scipy.special import softmax

from truepose import diagnose, load_machine, load_recording
from truepose.identification import prior
from truepose.identification.diagnosis.search import Found
from truepose.identification.posterior.state import State
from truepose.models.effects.empirical import Empirical

Array = NDArray[np.float64]
JOBS = 2


@dataclass(frozen=True)
class Expected:
    """Of one case: the levels of richness (3,), numbers of causes and of nameless ones, members by size (s,), noise in stated
    sigmas (log), and tolerances as stated."""

    richness: Array
    causes: float
    nameless: float
    sizes: Array
    log_noise: float
    stated: float


def expected(case: Path) -> Expected:
    """Expectations under the posterior of a case."""
    machine = load_machine(case / "machine.yaml")
    rows = load_recording(machine, [case / "recording.csv"])
    found: Expected = diagnose(machine, rows, examine=lambda found, _: _of(found)).examined
    return found


def _of(found: Found) -> Expected:
    states = found.posterior.states
    rows = [_counts(found, state) for state, _ in states]
    mean = np.average(np.array(rows), axis=0, weights=[share for _, share in states])
    levels = len(prior.RICHNESS.filled)
    richness, (causes, nameless, noise, stated), sizes = np.split(mean, [levels, levels + 4])
    return Expected(richness, causes, nameless, sizes, noise, stated)


def _counts(found: Found, state: State) -> Array:
    """One row of all that is averaged."""
    problem = found.problem
    numbers = [int(problem.spike_slab.terms.cause[term]) for term, _ in state.members]
    causes = [problem.causes[k] for k in dict.fromkeys(numbers)]
    sizes = np.bincount([size for _, size in state.members], minlength=len(prior.SIZES.values))
    noise, widening = state.point
    counts = [
        len(causes),
        sum(c.effect == Empirical.slug for c in causes),
        np.log(problem.spike_slab.unknowns.noise[0].values[noise[0]]),
        widening == 0,
    ]
    levels = softmax(prior.RICHNESS.log_weights(len(state.members)))
    return np.concatenate([levels, np.array(counts, dtype=np.float64), sizes])


def table(cases: Sequence[Expected]) -> Iterator[str]:
    """Lines of Markdown: every number as it is, and as these cases would have it."""
    yield "| number | prior | expected |"
    yield "|---|---|---|"
    richness = np.mean([c.richness for c in cases], axis=0)
    yield f"| machines that are simple, usual, rich | {_row(np.exp(prior.RICHNESS.log_prior))} | {_row(richness)} |"
    total = sum(c.causes for c in cases)
    own = prior.RICHNESS.slots * float(np.exp(prior.RICHNESS.log_prior) @ prior.RICHNESS.filled)
    yield f"| causes a machine | {own:.2f} | {total / len(cases):.2f} |"
    yield f"| of these without a name | {prior.UNNAMED_SHARE:.2f} | {_share(sum(c.nameless for c in cases), total)} |"
    sizes = np.sum([c.sizes for c in cases], axis=0)
    ends = f"{prior.SIZES.values[0]:g} to {prior.SIZES.values[-1]:g}"
    yield f"| members by size, {ends} | {_row(np.exp(prior.SIZES.log_prior))} | {_row(sizes / max(np.sum(sizes), 1.0))} |"
    off = np.abs([c.log_noise for c in cases])
    yield f"| noise within 20 % of sigma | {_within(0.2):.2f} | {np.mean(off < np.log(1.2)):.2f} |"
    yield f"| tolerances as stated | | {np.mean([c.stated for c in cases]):.2f} |"


def _within(share: float) -> float:
    """Prior probability that the noise is off by less than a share: over the values of its grid up to twice the stated one."""
    values = np.exp(np.arange(np.log(prior.NOISE_FROM), np.log(2.0), prior.NOISE_STEP))
    likely = softmax(np.array(prior.noise_log_prior(values.tolist())))
    return float(np.sum(likely[np.abs(np.log(values)) < np.log(1.0 + share)]))


def _share(part: float, whole: float) -> str:
    return f"{part / whole:.2f}" if whole > 0.0 else "none"


def _row(values: Array) -> str:
    return ", ".join(f"{v:.2f}" for v in values)


def main(folders: Sequence[Path]) -> None:
    """Diagnose all, print the table."""
    cases = [case for folder in folders for case in sorted(folder.glob("cases/*"))]
    found = Parallel(n_jobs=JOBS, batch_size=1)(delayed(expected)(case) for case in cases)
    sys.stdout.write("\n".join([f"{len(cases)} cases", "", *table(found)]) + "\n")


if __name__ == "__main__":
    main([Path(folder) for folder in sys.argv[1:]])
