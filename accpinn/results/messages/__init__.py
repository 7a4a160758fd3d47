"""Texts that combine several results: summaries, verdicts and ratings in words.

What a single finding says stands in its class (see `accpinn.findings`).
"""

from collections.abc import Iterable

from accpinn.findings import Finding, Labelled


def messages(findings: Iterable[Finding], about: Labelled) -> tuple[str, ...]:
    """The sentences of findings, in their order; ``about`` names recording and vehicles."""
    return tuple(finding.sentence(about) for finding in findings)
