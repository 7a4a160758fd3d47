"""The paper's training protocol as its authors run it, to be timed.

Network 1-60-60-60-(2M+1) in double precision on all instants, time derivatives by nested
automatic differentiation (one gradient call an output), Adam on weights and parameters.
"""

from itertools import pairwise

import torch
from torch import Tensor, nn

from accpinn.methods.pinn.config import PAPER
from accpinn.segment.segment import Segment
from bench.measurement import spent_on

WARM_UP = 3


class PaperProtocol:
    """A training of one segment by the paper's protocol."""

    def __init__(self, segment: Segment) -> None:
        """Start from Xavier-uniform weights and parameters (1, 1, 1)."""
        torch.manual_seed(0)
        self.followers = segment.followers
        self.time = torch.tensor(segment.time)[:, None].requires_grad_()
        self.speeds = torch.tensor(segment.speeds)
        self.gaps = torch.tensor(segment.gaps)
        layers: list[nn.Module] = []
        sizes = [1, *PAPER.hidden, 2 * self.followers + 1]
        for before, after in pairwise(sizes):
            layer = nn.Linear(before, after, dtype=torch.float64)
            nn.init.xavier_uniform_(layer.weight)
            nn.init.zeros_(layer.bias)
            layers += [layer, nn.Tanh()]
        self.network = nn.Sequential(*layers[:-1])
        self.parameters = torch.ones(self.followers, 3, dtype=torch.float64, requires_grad=True)
        self.optimiser = torch.optim.Adam([*self.network.parameters(), self.parameters], lr=1e-3)

    def iterate(self) -> None:
        """Take one full-batch Adam iteration."""
        self.optimiser.zero_grad()
        self.loss().backward()
        self.optimiser.step()

    def loss(self) -> Tensor:
        """Return Ψ with all weights 1; a test compares it with that of the package."""
        outputs = self.network(self.time)
        split = self.followers + 1
        speeds, gaps = outputs[:, :split], outputs[:, split:]
        loss = ((speeds - self.speeds) ** 2).mean(0).sum() + ((gaps - self.gaps) ** 2).mean(0).sum()
        for follower in range(self.followers):
            gap, speed = gaps[:, follower], speeds[:, follower + 1]
            relative = speeds[:, follower] - speed
            alpha, beta, tau = self.parameters[follower]
            acceleration = alpha * (gap - tau * speed) + beta * relative
            loss = loss + ((self._rate(gap) - relative) ** 2).mean()
            loss = loss + ((self._rate(speed) - acceleration) ** 2).mean()
        return loss / self.followers

    def _rate(self, output: Tensor) -> Tensor:
        return torch.autograd.grad(output.sum(), self.time, create_graph=True)[0][:, 0]


def seconds_per_iteration(segment: Segment, iterations: int) -> list[float]:
    """Return the time of each of ``iterations`` in s, after a warm-up."""
    training = PaperProtocol(segment)
    for _ in range(WARM_UP):
        training.iterate()
    return [spent_on(training.iterate)[0] for _ in range(iterations)]
