"""Every finding has a sentence that names its vehicle and tells every number it holds."""

import re
from random import Random
from types import NoneType
from typing import Any, Literal, get_args, get_origin, get_type_hints

import pytest
from msgspec.structs import replace

import accpinn.results.report  # noqa: F401  all modules that have findings
from accpinn.findings import Finding, joined, probability
from accpinn.inference.identifiability import WeakIdentification
from accpinn.inference.model_adequacy import FORMS
from accpinn.inference.trust import Trust
from accpinn.inference.typical import HeterogeneousFollowers, HeterogeneousWindows
from accpinn.methods.findings import HiddenLayersGain
from accpinn.recordings import SamplesMissing, Window
from accpinn.segment import Bridged, DrivenByHand

KINDS = [
    kind
    for kind in Finding.__subclasses__()
    if kind.__module__.startswith("accpinn.") and hasattr(kind, "text")
]
BLOCKS = (Window(1.0, 2.5), Window(4.0, 4.0))
KEYS = {"channel": ("Speed", "IVS"), "form": FORMS[1:], "problem": ("It is broken.",)}
"""Values of texts that are not any."""
VALUES: dict[Any, tuple[Any, ...]] = {
    bool: (True, False), int: (0, 1, 2, 3), float: (0.0571, 0.8, 41.0), str: ("α", "31, {2"),
    Window: BLOCKS, NoneType: (None,),
}  # fmt: skip
OTHER: dict[Any, Any] = {
    bool: lambda known: not known,
    int: lambda known: 5 - known,
    float: lambda known: 5 - known,
    str: lambda known: f"{known}x",
}


class About:
    """Vehicles with names."""

    source = "run.csv"

    def label(self, number: int) -> str:
        return f"{number} Audi"


def value(name: str, hint: Any, random: Random, count: int) -> Any:
    """Of a field with that name and type; so many of what it may have several."""
    parts = get_args(hint)
    if get_origin(hint) is tuple:
        kinds = count * [parts[0]] if parts[-1] is ... else parts
        return tuple(value(name, kind, random, count) for kind in kinds)
    if parts and get_origin(hint) is not Literal:
        return value(name, random.choice(parts), random, count)
    return random.choice(parts or KEYS.get(name) or VALUES[hint])


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.__name__)
def test_a_sentence_has_its_vehicle_and_figures(kind: type[Finding]) -> None:
    hints, random, told = get_type_hints(kind), Random(0), set()
    names = kind.__struct_fields__
    plain = {name for name in names if hints[name] in OTHER and name not in KEYS}
    for _ in range(100):
        count = random.choice((1, 2))
        fields = {name: value(name, hints[name], random, count) for name in names}
        finding = kind(**fields)
        sentence = finding.sentence(About())
        assert sentence.endswith(".")
        assert not {"{", "}"} & {*sentence.replace("31, {2", "")}
        assert not [odd for odd in ("nan", "None", "inf ") if odd in sentence]
        if vehicle := fields.get("vehicle", fields.get("follower")):
            assert re.search(rf"\b({vehicle} Audi|(IVS|Speed|Driver){vehicle}\b)", sentence)
        for name in plain:
            other = replace(finding, **{name: OTHER[hints[name]](fields[name])})
            told |= {name} if other.sentence(About()) != sentence else set()
    # The speed of a verdict on windows stands in the table of parameters.
    assert plain - told == ({"speed"} if kind is Trust else set())


@pytest.mark.parametrize(
    ("finding", "facts"),
    [
        (SamplesMissing("Speed", 2, 0.574, BLOCKS), ["Speed2", "57 %", "1–2.5 s"]),
        (SamplesMissing("IVS", 2, 0.003, BLOCKS * 3), ["IVS2", "0.3 %", "3 shorter blocks"]),
        (Bridged("IVS1", 1, BLOCKS[1:]), ["1 sample of", "IVS1", "4 s"]),
        (DrivenByHand((3,), (0.5,)), ["3 Audi", "50 %"]),
        (HiddenLayersGain(1.0, 0.5), ["1.000", "0.5000", "-50.0 %"]),
        (WeakIdentification(0, (), 0.05), ["All followers", "0.05 m/s"]),
        (
            HeterogeneousWindows((2, 3), 5, 0.012, 0.2),
            ["5 windows", "and 3 Audi", "0.012", "0.20 s"],
        ),
        (HeterogeneousFollowers(4, 1e-9), ["4 followers", "p < 0.001"]),
    ],
)
def test_figures_are_rounded_and_have_their_units(finding: Finding, facts: list[str]) -> None:
    assert [fact for fact in facts if fact not in finding.sentence(About())] == []


def test_lists_and_probabilities() -> None:
    assert [joined(["α", "β", "τ"][:count]) for count in (0, 1, 3)] == ["", "α", "α, β and τ"]
    shown = [probability(share) for share in (0.005, 0.5, 1.0)]
    assert shown == ["under 1 %", "50 %", "over 99 %"]


def test_a_driver_is_named_of_the_vehicles_in_question_alone() -> None:
    found = DrivenByHand((2, 3), (0.5, 1.0), by_flag=True)
    assert found.among([3, 5]) == DrivenByHand((3,), (1.0,), by_flag=True)
    assert found.among([4]) is None
