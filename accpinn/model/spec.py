"""The specification of a model: its key, and the parameters that keep given values."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Self

from accpinn.arguments import checked_method
from accpinn.errors import ConfigError
from accpinn.model.following import FollowingModel
from accpinn.model.registry import BEST, FOLLOWING, PAPER, Fixed, following_model


@dataclass(frozen=True)
class ModelSpec:
    """A car-following model whose parameters are estimated, except those that are fixed."""

    model: str = PAPER
    """Key of the model in `FOLLOWING`."""
    fixed: Fixed = ()
    """Names and values of the parameters that are not estimated, in the order of their names."""

    @classmethod
    @checked_method
    def of(cls, model: str, fixed: Mapping[str, float] | None = None) -> Self:
        """The specification of a model by its key, with some parameters fixed, as {"s0": 4.0}.

        Raises:
            ConfigError: for an unknown model, a parameter that cannot be fixed, or a value outside
                its range.
        """
        chosen = following_model(model)
        ranges = chosen.fixable
        for name, value in (fixed or {}).items():
            if name not in ranges:
                fixable = ", ".join(ranges) or "no parameter"
                raise ConfigError(
                    f"fixed: {str(name)[:20]} cannot be fixed; {model} has {fixable} to fix."
                )
            least, most = ranges[name]
            if not least <= value <= most:
                allowed = f"{least:g} to {most:g}"
                if value == 0 and name in chosen.terms:
                    allowed += ", or a model without it"
                raise ConfigError(f"fixed: {name} = {value:g} is not allowed; choose {allowed}.")
        pairs = ((name, float(value)) for name, value in (fixed or {}).items())
        return cls(chosen.key, tuple(sorted(pairs)))

    @property
    def following(self) -> FollowingModel:
        """The model."""
        return FOLLOWING[self.model]

    @property
    def in_words(self) -> str:
        """The model's title, and what is fixed: "CTHP with intercept s₀, s₀ = 4 m"."""
        kinds = {parameter.name: parameter for parameter in self.following.parameters}
        values = (f"{kinds[n].symbol} = {v:g} {kinds[n].unit}" for n, v in self.fixed)
        return ", ".join([self.following.title, *values])


PAPER_SPEC = ModelSpec()
"""The paper's model with nothing fixed, which every method can estimate."""
RECOMMENDED_SPEC = ModelSpec(BEST)
"""The model that is estimated unless another is asked for."""
