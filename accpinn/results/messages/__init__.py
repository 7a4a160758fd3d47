"""Texts that combine several results: summaries, verdicts and ratings in words.

What a single finding says stands in its class (see `accpinn.findings`).
"""

from collections.abc import Iterable
from typing import TYPE_CHECKING

from accpinn.findings import Finding, Labelled

if TYPE_CHECKING:  # its import takes a while, and few commands evaluate
    from accpinn.evaluation import Evaluation


def messages(findings: Iterable[Finding], about: Labelled) -> tuple[str, ...]:
    """The sentences of findings, in their order; ``about`` names recording and vehicles.

    Examples:
        >>> import accpinn
        >>> result = accpinn.fit(accpinn.sample("motorway"), vehicles="1-2", method="splines")
        >>> isinstance(accpinn.messages(result.findings, result.info), tuple)
        True
    """
    return tuple(finding.sentence(about) for finding in findings)


def incidents(evaluation: "Evaluation", about: Labelled) -> tuple[str, ...]:
    """Collisions, reversing and divergence in the closed-loop simulation, the window's first."""
    inside = messages(evaluation.findings, about)
    outside = messages(evaluation.out_of_window_findings, about)
    return (*inside, *(f"Outside the window, {said[0].lower()}{said[1:]}" for said in outside))
