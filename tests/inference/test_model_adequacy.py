"""One term more in the model: known departures are found and named."""

from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest

from accpinn.inference.model_adequacy import BetterForm, ModelForm, better_forms, model_forms
from accpinn.methods.regression import one_second_means
from accpinn.model.cthp import Parameters
from accpinn.recordings.openacc import read
from accpinn.results.messages import message
from accpinn.results.tables.estimates import FORMS, model_form_table
from accpinn.segment.cut import cut
from accpinn.segment.segment import Segment
from bench.disturbed import Disturbance, disturbed

TRUE = (0.1, 0.3, 1.2)


def recorded(duration: float = 300.0, deviation: float = 0.02, **departure: float) -> Segment:
    disturbance = Disturbance(deviation, 1.0, **departure)
    return disturbed(Parameters.of([TRUE]), 1, disturbance, duration=duration)


def by_form(segment: Segment) -> dict[str, ModelForm]:
    return {found.form: found for found in model_forms(segment)}


def better(segment: Segment) -> tuple[BetterForm, ...]:
    return better_forms(segment.vehicles, model_forms(segment))


def test_where_the_cthp_holds_nothing_is_better() -> None:
    found = by_form(recorded())
    np.testing.assert_allclose(found["as it is"].parameters[0].values, TRUE, rtol=0.1)
    assert abs(found["standstill distance"].extra[0]) < 0.5
    assert found["delay"].extra[0] <= 0.2
    assert better(recorded()) == ()


def test_a_standstill_distance_is_found() -> None:
    segment = recorded(standstill=6.0)
    found = by_form(segment)["standstill distance"]
    assert found.extra[0] == pytest.approx(6.0, abs=0.5)
    assert found.parameters[0].tau == pytest.approx(1.2, abs=0.05)
    assert by_form(segment)["as it is"].parameters[0].tau > 1.3, "the CTHP puts it into τ"
    table = model_form_table(segment.info, model_forms(segment), 0)
    assert [row[0] for row in table.rows] == list(FORMS.values())
    assert table.rows[1][4] == found.extra[0]
    assert table.rows[0][4:6] == (None, None)


def test_a_slow_actuator_shows_as_a_delay() -> None:
    segment = recorded(deviation=0.1, lag=1.0)
    found = by_form(segment)
    assert 0.5 <= found["delay"].extra[0] <= 1.5
    assert found["as it is"].parameters[0].beta < 0.2, "the CTHP loses half of β"
    assert found["delay"].parameters[0].beta == pytest.approx(0.3, rel=0.2)
    (finding,) = better(segment)
    assert (finding.vehicle, finding.form, finding.extra) == (2, "delay", found["delay"].extra[0])
    sentence = message(finding, segment)
    assert sentence.startswith(f"{segment.labels[1]}: with a delay of {finding.extra:.1f} s")
    longest = message(msgspec.structs.replace(finding, extra=3.0), segment)
    assert "the longest tried" in longest


def test_masked_seconds_do_not_count() -> None:
    segment = recorded()
    early = segment.time[:, None] < 200.0
    masked = replace(segment, gaps=segment.gaps + np.where(early, 0.0, 30.0), mask=early)
    assert not one_second_means(masked).mask[0, -1]
    found = by_form(masked)["as it is"]
    np.testing.assert_allclose(found.parameters[0].values, TRUE, rtol=0.1)


def test_a_short_window_gives_nothing() -> None:
    short = recorded(duration=20.0)
    for found in model_forms(short):
        assert np.isnan(found.parameters.values).all()
    assert better(short) == ()


def test_the_delay_of_the_real_hyundai_matters(openacc_dir: Path) -> None:
    """In Casale a delay explains held-out accelerations better."""
    segment = cut(read(openacc_dir / "Casale" / "part7.csv"), 0, 300)
    found = by_form(segment)
    values = found["as it is"].parameters[0].values
    assert values == pytest.approx([0.0104, 0.071, 1.52], rel=0.02)
    assert found["delay"].holdout[0] > found["as it is"].holdout[0] + 0.05
    assert [one.form for one in better(segment)] == ["delay"]
