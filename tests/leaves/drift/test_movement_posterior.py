"""Which movements are believed: evidence against dense Gaussians, probabilities against enumeration, and their prior."""

from __future__ import annotations

import numpy as np
from scipy.linalg import block_diag
from scipy.special import softmax
from scipy.stats import multivariate_normal

from support.stacked_sessions import covariance_of, likeliest_of, plain, stacked
from truepose.identification.leaves.drift.sessions import Kinds, likeliest
from truepose.identification.posterior.design import GridPoint
from truepose.identification.posterior.posterior import sample
from truepose.identification.posterior.spike_slab import Members
from truepose.identification.posterior.state import log_posterior
from truepose.identification.prior import RICHNESS


def test_evidence_is_that_of_the_dense_gaussian() -> None:
    """Of sets of movements at sizes, at any noise and widening of tolerances, against covariances written out in full."""
    stack, ours, theirs = stacked(81), list[float](), list[float]()
    for moving in ({}, {1: 0.3}, {0: 3.0}, {0: 0.1, 2: 10.0}, {0: 1.0, 1: 30.0, 2: 0.01}):
        for noise, widening in ((0.8, 0), (2.0, 1), (1.0, 3)):
            top = likeliest_of(stack, moving, noise, widening)
            seen, point = block_diag(*stack.jacobian), top.state.point
            cov = seen @ covariance_of(top) @ seen.T + top.noise**2 * np.eye(len(seen))
            ours.append(top.spike_slab.log_evidence(point, top.state.members))
            theirs.append(
                float(multivariate_normal.logpdf(stack.offset.ravel(), cov=cov))
                + top.spike_slab.unknowns.log_prior(point)
            )
    # evidence is known up to a constant
    np.testing.assert_allclose(np.diff(ours), np.diff(theirs), atol=1e-7)


def test_probabilities_are_those_of_all_sets_at_all_sizes_and_points() -> None:
    """Two parameters, one of which moves by about what can be seen: sampled against enumerated."""
    rng = np.random.default_rng(1)
    jacobian = rng.standard_normal((2, 40, 2))
    kinds = Kinds(("a", "c"), np.array([False, True]))
    undecided = 0
    for size in (1.0, 1.1, 1.15):
        apart = np.array([-size / 2, size / 2])[:, None] * jacobian[:, :, 0]
        stack = plain(jacobian, apart + rng.standard_normal((2, 40)), 3.0)
        top = likeliest(stack, kinds)
        problem = top.spike_slab
        found = [sample(problem, RICHNESS, seed=seed, known=[top.state]).causes for seed in range(1, 5)]
        points = [
            GridPoint((k,), w, 0)
            for k in range(len(problem.unknowns.noise[0].values))
            for w in range(len(problem.unknowns.widening))
        ]
        sizes = range(len(problem.sizes.values))
        ones = [((i, s),) for i in (0, 1) for s in sizes]
        sets: list[Members] = [(), *ones, *(((0, s), (1, t)) for s in sizes for t in sizes)]
        logs = [np.logaddexp.reduce([log_posterior(problem, RICHNESS, m, p) for p in points]) for m in sets]
        share = softmax(logs)
        own = [sum(p for p, m in zip(share, sets, strict=True) if i in dict(m)) for i in (0, 1)]
        np.testing.assert_allclose(np.mean(found, axis=0), own, atol=0.06)  # chains end as soon as two agree
        undecided += any(0.1 < p < 0.9 for p in own)
    assert undecided
