"""Would one term more in the law change the answer: known departures are found and named."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from accpinn.inference.model_adequacy import ModelForm, better, model_forms
from accpinn.methods.regression import one_second_means
from accpinn.model.cthp import Parameters
from accpinn.recordings.openacc import read
from accpinn.results.tables.estimates import FORMS, model_form_table
from accpinn.segment.cut import cut
from accpinn.segment.segment import Segment
from bench.disturbed import Disturbance, disturbed

LAW = Parameters(0.1, 0.3, 1.2)


def recorded(duration: float = 300.0, deviation: float = 0.02, **departure: float) -> Segment:
    return disturbed((LAW,), 1, Disturbance(deviation, 1.0, **departure), duration=duration)


def by_form(segment: Segment) -> dict[str, ModelForm]:
    return {found.form: found for found in model_forms(segment)}


def test_where_the_law_holds_nothing_is_better() -> None:
    found = by_form(recorded())
    np.testing.assert_allclose(found["as it is"].parameters[0], [0.1, 0.3, 1.2], rtol=0.1)
    assert abs(found["standstill distance"].extra[0]) < 0.5
    assert found["delay"].extra[0] <= 0.2
    assert better(("2 Car",), model_forms(recorded())) == ()


def test_a_distance_kept_at_standstill_is_found() -> None:
    segment = recorded(standstill=6.0)
    found = by_form(segment)["standstill distance"]
    assert found.extra[0] == pytest.approx(6.0, abs=0.5)
    assert found.parameters[0, 2] == pytest.approx(1.2, abs=0.05)
    assert by_form(segment)["as it is"].parameters[0, 2] > 1.3, "the law alone puts it into τ"


def test_a_slow_actuator_shows_as_a_delay() -> None:
    segment = recorded(deviation=0.1, lag=1.0)
    found = by_form(segment)
    assert 0.5 <= found["delay"].extra[0] <= 1.5
    assert found["as it is"].parameters[0, 1] < 0.2, "the law alone takes half of β away"
    assert found["delay"].parameters[0, 1] == pytest.approx(0.3, rel=0.2)
    (sentence,) = better(("2 Car",), model_forms(segment))
    assert sentence.startswith("2 Car: with a delay of ")


def test_what_is_left_out_does_not_count() -> None:
    segment = recorded()
    late = segment.time[:, None] >= 200.0
    spoilt = replace(segment, gaps=segment.gaps + np.where(late, 30.0, 0.0))
    masked = replace(spoilt, left_out=late, excluded_regimes=("catching up",))
    assert not one_second_means(masked).mask[0, -1]
    found = by_form(masked)["as it is"]
    np.testing.assert_allclose(found.parameters[0], [0.1, 0.3, 1.2], rtol=0.1)


def test_a_short_window_says_nothing() -> None:
    for found in model_forms(recorded(duration=20.0)):
        assert np.isnan(found.parameters).all()
    assert better(("2 Car",), model_forms(recorded(duration=20.0))) == ()


def test_the_delay_of_the_real_hyundai_matters(openacc_dir: Path) -> None:
    """In Casale a delayed law explains accelerations that it has not seen better."""
    segment = cut(read(openacc_dir / "Casale" / "part7.csv"), 0, 300)
    found = by_form(segment)
    assert found["as it is"].parameters[0] == pytest.approx([0.0104, 0.071, 1.52], rel=0.02)
    assert found["delay"].unseen[0] > found["as it is"].unseen[0] + 0.05
    assert better(segment.labels[1:], model_forms(segment))


def test_the_table_has_a_row_a_form() -> None:
    segment = recorded(standstill=6.0)
    table = model_form_table(segment, model_forms(segment), 0)
    assert [row[0] for row in table.rows] == list(FORMS.values())
    assert table.rows[1][4] == pytest.approx(6.0, abs=0.5)
    assert table.rows[0][4:6] == (None, None)
    assert "s₀" in table.to_html()
