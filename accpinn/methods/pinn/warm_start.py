"""Where a training can begin instead of at random weights: what an earlier one has learned."""

import hashlib
from dataclasses import dataclass

import numpy as np
import torch
from torch import nn

from accpinn.errors import ConfigError
from accpinn.methods.fit import Fit
from accpinn.model.cthp import Case
from accpinn.units import FloatArray


@dataclass(frozen=True, eq=False)
class WarmStart:
    """Weights and parameters of an earlier fit."""

    arrays: dict[str, FloatArray]
    """As in `Fit.arrays`."""
    table: FloatArray
    """(M, 3): α, β, τ per follower."""
    origin: str
    """Whose they are, as "snapshot 0123456789abcdef"."""

    @classmethod
    def of(cls, fit: Fit, origin: str) -> "WarmStart":
        """Those of a fit."""
        return cls(fit.arrays, fit.parameters.values, origin)

    def digest(self) -> str:
        """SHA-256: equal digests mean an equal start."""
        found = hashlib.sha256()
        for name, values in [*sorted(self.arrays.items()), ("", self.table)]:
            found.update(f"{name}{values.shape}{values.dtype}".encode())
            found.update(np.ascontiguousarray(values).tobytes())
        return found.hexdigest()

    @property
    def note(self) -> str:
        """What the result says of its start."""
        return f"Started from the weights of {self.origin}."

    def parameters(self, case: Case, followers: int) -> FloatArray:
        """(1, 3) or (M, 3) α, β, τ to begin with; τ is 0 where it was undetermined.

        Raises:
            ConfigError: when it has another number of followers.
        """
        if self.table.shape != (followers, 3):
            raise ConfigError(
                f"The weights of {self.origin} are for {len(self.table)} followers, the window has"
                f" {followers}; choose the same vehicles, or start without them."
            )
        table = np.nan_to_num(self.table)
        alike = (table == table[0]).all()
        return (table[:1] if alike else table.mean(axis=0)[None]) if case == "I" else table

    def load_into(self, module: nn.Module, prefix: str) -> None:
        """Give a network the weights whose names begin with ``prefix``.

        Raises:
            ConfigError: when they are another network's.
        """
        given = {
            name.removeprefix(prefix): torch.from_numpy(np.array(values))
            for name, values in self.arrays.items()
            if name.startswith(prefix)
        }
        wanted = {name: value.shape for name, value in module.state_dict().items()}
        if {name: value.shape for name, value in given.items()} != wanted:
            raise self.misfit()
        module.load_state_dict(given)

    def misfit(self) -> ConfigError:
        """The sentence for weights that another network has."""
        return ConfigError(
            f"The weights of {self.origin} do not fit this network; choose the preset, the window"
            " and the highest frequency they were trained with, or start without them."
        )
