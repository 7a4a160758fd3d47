"""Every sentence that is made from data, in one place: for pages, report and command line alike.

`message` turns a finding into its sentence. Each module here registers those of one subject.
"""

from collections.abc import Iterable, Sequence
from functools import singledispatch
from importlib import import_module
from typing import Protocol

from accpinn.errors import Finding

SUBJECTS = ("data", "methods", "reliability", "stability", "snapshot")
"""The modules that register sentences, imported until one has that of a finding: the later ones
need much that a command may do without."""


class Labelled(Protocol):
    """What a sentence is about: a recording, a segment or a segment's description."""

    @property
    def source(self) -> str:
        """File name of the recording."""

    def label(self, number: int) -> str:
        """The label of the vehicle with that number in the file."""


@singledispatch
def message(finding: Finding, about: Labelled) -> str:
    """The sentence for a finding.

    Args:
        finding: of any room.
        about: names the vehicles in the sentence.

    Raises:
        NotImplementedError: for a kind of finding without a sentence.
    """
    for subject in SUBJECTS:
        import_module(f"{__name__}.{subject}")
        sentence = message.dispatch(type(finding))
        if sentence is not message.dispatch(object):
            return sentence(finding, about)
    raise NotImplementedError(type(finding).__name__)


def messages(findings: Iterable[Finding], about: Labelled) -> tuple[str, ...]:
    """One sentence a finding, in their order."""
    return tuple(message(finding, about) for finding in findings)


def joined(parts: Sequence[str]) -> str:
    """A list as a sentence has it: "α, β and τ"."""
    return " and ".join([", ".join(parts[:-1]), parts[-1]] if len(parts) > 1 else parts)


def percent(share: float) -> str:
    """A share as a sentence has it: "35 %"."""
    return f"{100 * share:.0f} %"


def probability(share: float) -> str:
    """A share of draws; none of finitely many is neither impossible nor certain."""
    if share < 0.005:
        return "under 1 %"
    return "over 99 %" if share > 0.995 else percent(share)
