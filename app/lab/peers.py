"""What a user would pick instead, behind one door: BoTorch's and Optuna's preference learners.

Both are optional (the extra `bench`) and imported only when a peer is made. Each is set up as its
own documentation does it; over a finite set of candidates both can look at every one.
"""

from collections.abc import Callable, Sequence
from importlib import import_module
from itertools import combinations
from typing import Any, Final, Protocol

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
# (winner, loser), rows of the candidates.
Pairs = Sequence[tuple[int, int]]
# As BoTorch's SIGMA_JITTER.
SMALLEST_VARIANCE: Final = 1e-8


class Peer(Protocol):
    """A preference optimiser that is not ours."""

    def step(self, pairs: Pairs) -> tuple[int, int]:
        """Learn from all answers so far, and propose the next two candidates."""

    def best(self) -> int:
        """The candidate with the largest posterior mean after the last step."""


class BotorchPairwise:
    """`PairwiseGP` (Laplace), its hyperparameters fitted at every step, with the analytic expected
    utility of the best option over every pair of candidates.

    The expectation is that of `AnalyticExpectedUtilityOfBestOption`, from one joint posterior over
    all candidates: asking the class for each of 26,565 pairs takes several times as long.
    """

    def __init__(self, candidates: FloatArray, seed: int) -> None:
        self._torch = import_module("torch")
        self._models = import_module("botorch.models.pairwise_gp")
        self._fit = import_module("botorch.fit")
        self._torch.manual_seed(seed)
        self._points = self._torch.tensor(candidates, dtype=self._torch.float64)
        self._pairs = self._torch.tensor(list(combinations(range(len(candidates)), 2))).T
        self._mean: Any = None

    def step(self, pairs: Pairs) -> tuple[int, int]:
        torch = self._torch
        seen, place = np.unique(np.array(pairs), return_inverse=True)
        comparisons = torch.tensor(place.reshape(-1, 2))
        model = self._models.PairwiseGP(self._points[seen.tolist()], comparisons)
        likelihood = self._models.PairwiseLaplaceMarginalLogLikelihood(model.likelihood, model)
        self._fit.fit_gpytorch_mll(likelihood)
        with torch.no_grad():
            posterior = model.posterior(self._points)
            self._mean = posterior.mean.squeeze(-1)
            covariance = posterior.covariance_matrix
            a, b = self._pairs
            delta = self._mean[a] - self._mean[b]
            own = covariance.diagonal()
            variance = own[a] + own[b] - 2.0 * covariance[a, b]
            sigma = variance.clamp(min=SMALLEST_VARIANCE).sqrt()
            normal = torch.distributions.Normal(0.0, 1.0)
            u = delta / sigma
            values = sigma * (normal.log_prob(u).exp() + u * normal.cdf(u)) + self._mean[b]
            chosen = int(values.argmax())
        return int(a[chosen]), int(b[chosen])

    def best(self) -> int:
        return int(self._mean.argmax())


class OptunaPreferential:
    """The model of optuna-dashboard's `PreferentialGPSampler`, with its own kernel and priors and
    its logarithmic expected improvement over every candidate. It proposes one candidate; the other
    is the one it holds for best, as its user would be shown."""

    def __init__(self, candidates: FloatArray, seed: int) -> None:
        self._torch = import_module("torch")
        self._analytic = import_module("botorch.acquisition.analytic")
        self._optim = import_module("botorch.optim")
        gpytorch = import_module("gpytorch")
        sampler = import_module("optuna_dashboard.preferential.samplers.gp")
        self._torch.manual_seed(seed)
        self._points = self._torch.tensor(candidates, dtype=self._torch.float64)
        dimensions = candidates.shape[1]
        # As in PreferentialGPSampler.sample_relative.
        self._gp = sampler._PreferentialGP(
            kernel=gpytorch.kernels.MaternKernel(
                nu=1.5,
                ard_num_dims=dimensions,
                lengthscale_prior=gpytorch.priors.GammaPrior(5.0, 10.0),
                lengthscale_constraint=gpytorch.constraints.GreaterThan(
                    0.0, transform=self._torch.exp, inv_transform=self._torch.log
                ),
            ),
            noise_prior=gpytorch.priors.GammaPrior(5.0, 50.0),
            dims=dimensions,
        )
        self._sampled: Any = None

    def step(self, pairs: Pairs) -> tuple[int, int]:
        seen, place = np.unique(np.array(pairs), return_inverse=True)
        points = self._points[seen.tolist()]
        preferences = self._torch.tensor(place.reshape(-1, 2), dtype=self._torch.int32)
        self._sampled = self._gp.sample_gp(points, preferences)
        known = self._sampled.posterior(points[:, None, :]).mean
        acquisition = self._analytic.LogExpectedImprovement(model=self._sampled, best_f=known.max())
        chosen, _ = self._optim.optimize_acqf_discrete(
            acq_function=acquisition, choices=self._points, q=1
        )
        challenger = int((self._points - chosen[0]).abs().sum(dim=1).argmin())
        best = int(seen[int(known.argmax())])
        if challenger == best:
            others = [int(i) for i in seen if i != best]
            challenger = others[0]
        return best, challenger

    def best(self) -> int:
        with self._torch.no_grad():
            return int(self._sampled.posterior(self._points[:, None, :]).mean.argmax())


PEERS: Final[dict[str, Callable[[FloatArray, int], Peer]]] = {
    "botorch PairwiseGP + EUBO": BotorchPairwise,
    "optuna PreferentialGPSampler": OptunaPreferential,
}
