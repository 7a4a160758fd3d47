"""Tables: the right numbers under the right headings, and nothing of a name interpreted."""

import csv as csv_format
import io
import re
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from accpinn.evaluation.errors import TrackingErrors
from accpinn.inference.intervals import intervals
from accpinn.methods.fit import Fit, Outcome
from accpinn.model.cthp import Parameters
from accpinn.recordings.openacc import read
from accpinn.results.tables.estimates import comparison_table, parameter_table, quality_table
from accpinn.results.tables.table import ABSENT, Column, Table, latex
from accpinn.segment.cut import cut
from accpinn.segment.quality import assess_quality
from accpinn.segment.segment import Segment
from tests.support.openacc_files import csv, metadata, platoon

LAWS = (Parameters(0.01037, 0.07235, 1.52034), Parameters(0.1, 0.2, 1.0))
NASTY = ["<script>alert(1)</script>", "A&B_50%$x$^2", r"\input{secret}~#{}"]


@pytest.fixture
def segment() -> Segment:
    run = read(csv(platoon(), metadata(("Audi(A8)", "BMW", "Tesla"))), "run.csv")
    return cut(run, 5.0, 30.0)


@pytest.fixture
def fit() -> Fit:
    return Fit("pinn", "II", LAWS, None, Outcome.SETTLED, 1.0, {"preset": "fast"})


def errors(scale: float) -> TrackingErrors:
    speeds, gaps = scale * np.array([1.0, 2.0, 3.0]), scale * np.array([4.0, 5.0])
    return TrackingErrors(speeds, gaps, 10 * speeds, 10 * gaps)


class Cells(HTMLParser):
    """The texts of a table's cells, row by row, and every element there is."""

    def __init__(self) -> None:
        """Nothing read yet."""
        super().__init__()
        self.rows: list[list[str]] = []
        self.elements: set[str] = set()
        self._open = False

    def handle_starttag(self, tag: str, attrs: object) -> None:
        self.elements.add(tag)
        if tag == "tr":
            self.rows.append([])
        if tag in ("td", "th"):
            self.rows[-1].append("")
            self._open = True

    def handle_endtag(self, tag: str) -> None:
        if tag in ("td", "th"):
            self._open = False

    def handle_data(self, data: str) -> None:
        if self._open:
            self.rows[-1][-1] += data


def read_html(text: str) -> Cells:
    cells = Cells()
    cells.feed(text)
    return cells


# What the tables say


def test_parameters_and_errors_of_both_kinds(segment: Segment, fit: Fit) -> None:
    table = parameter_table(segment, fit, assess_quality(segment), errors(0.01), errors(1.0))
    head, *rows = read_html(table.to_html()).rows[1:]
    assert head == [
        "Vehicle", "α [1/s²]", "β [1/s]", "τ [s]", "Mean time gap [s]",
        "p [m]", "v [m/s]", "p [m]", "v [m/s]",
    ]  # fmt: skip
    assert rows[0] == ["1 Audi(A8)", *[ABSENT] * 5, "0.010", ABSENT, ABSENT]
    assert rows[1][:4] == ["2 BMW", "0.0104", "0.0723", "1.520"]
    assert rows[1][5:] == ["0.040", "0.020", "4.00", "2.000"]
    assert rows[2][5:] == ["0.050", "0.030", "5.00", "3.000"]
    assert float(rows[1][4]) == pytest.approx(assess_quality(segment).mean_time_gap[0], abs=0.005)


def test_the_two_kinds_of_errors_are_named_apart(segment: Segment, fit: Fit) -> None:
    table = parameter_table(segment, fit, assess_quality(segment), errors(0.01), errors(1.0))
    assert [c.group for c in table.columns[5:]] == [
        "Surrogate fit, MAE", "Surrogate fit, MAE",
        "Closed-loop simulation, MAE", "Closed-loop simulation, MAE",
    ]  # fmt: skip
    assert read_html(table.to_html()).rows[0][1:] == [
        "Surrogate fit, MAE",
        "Closed-loop simulation, MAE",
    ]
    assert "run.csv, 5–35 s" in table.caption
    assert "fast preset" in table.caption


def test_without_simulation_the_cells_are_empty_not_zero(segment: Segment, fit: Fit) -> None:
    lost = replace(fit, parameters=(Parameters(0.0, 0.2, float("nan")), LAWS[1]))
    table = parameter_table(segment, lost, assess_quality(segment), None, None)
    cells = read_html(table.to_html()).rows[3]
    assert cells[1:4] == ["0.0000", "0.2000", ABSENT]
    assert cells[5:] == [ABSENT] * 4
    row = list(csv_format.reader(io.StringIO(table.to_csv())))[2]
    assert row[3] == ""
    assert row[5:] == [""] * 4


def test_intervals_stand_beside_the_parameters_in_every_format(segment: Segment, fit: Fit) -> None:
    lower = np.array([[0.0, 0.05, 1.2], [0.01, 0.1, 1.0]])
    upper = np.array([[0.02, 0.09, np.inf], [0.03, 0.2, 1.3]])
    uncertainty = replace(intervals(segment, fit, draws=10), lower=lower, upper=upper)
    table = parameter_table(
        segment, fit, assess_quality(segment), errors(0.01), errors(1.0), uncertainty
    )
    _, head, leader, first, _ = read_html(table.to_html()).rows
    assert head[-3:] == ["α [1/s²]", "β [1/s]", "τ [s]"]
    assert leader[-3:] == [ABSENT] * 3
    assert first[-3:] == ["0.0000 to 0.0200", "0.0500 to 0.0900", "1.200 or more"]
    assert "90 % interval: τ [s]" in table.to_csv()
    assert "0.0500 to 0.0900" in table.to_latex()


def test_what_is_left_out_stands_in_every_title(segment: Segment, fit: Fit) -> None:
    """So that it also stands in an exported table."""
    without: Segment = replace(segment, excluded_regimes=("catching up", "manual"))
    for described in (without, without.info):
        for table in (
            parameter_table(described, fit, assess_quality(segment), None, None),
            comparison_table(described, {"PiNN": LAWS}),
            quality_table(described, assess_quality(segment), fit),
        ):
            assert "catching up, manual left out" in table.to_latex()
    assert "without" not in comparison_table(segment, {"PiNN": LAWS}).caption


def test_estimates_side_by_side(segment: Segment) -> None:
    other = (Parameters(0.011, 0.08, 1.6), Parameters(0.2, 0.3, 1.1))
    table = comparison_table(segment, {"PiNN": LAWS, "Truth": other})
    groups, head, first, second = read_html(table.to_html()).rows
    assert groups == ["", "α [1/s²]", "β [1/s]", "τ [s]"]
    assert head == ["Vehicle", *["PiNN", "Truth"] * 3]
    assert first == ["2 BMW", "0.0104", "0.0110", "0.0723", "0.0800", "1.520", "1.600"]
    assert second[0] == "3 Tesla"


def test_what_a_window_tells(segment: Segment, fit: Fit) -> None:
    quality = assess_quality(segment)
    _, head, first, _ = read_html(quality_table(segment, quality, fit).to_html()).rows
    assert head[4:] == ["Mean time gap [s]", "Car-following [%]", "Δv, std. [m/s]",
                         "Condition number"]  # fmt: skip
    assert first[5] == f"{100 * quality.car_following[0]:.0f}"
    assert first[1:4] == ["0.0104", "0.0723", "1.520"]


# Formats


def test_csv_has_full_precision_and_named_columns(segment: Segment, fit: Fit) -> None:
    table = parameter_table(segment, fit, assess_quality(segment), errors(0.01), errors(1.0))
    head, _, first, _ = list(csv_format.reader(io.StringIO(table.to_csv())))
    assert head[5] == "Surrogate fit, MAE: p [m]"
    assert head[8] == "Closed-loop simulation, MAE: v [m/s]"
    assert float(first[1]) == LAWS[0].alpha
    assert len(set(head)) == len(head)


def test_latex_is_a_table_of_the_same_cells(segment: Segment, fit: Fit) -> None:
    table = parameter_table(segment, fit, assess_quality(segment), errors(0.01), errors(1.0))
    text = table.to_latex()
    assert r"\begin{tabular}{lrrrrrrrr}" in text
    assert r"$\alpha$ [1/s$^2$]" in text
    assert r"2 BMW & 0.0104 & 0.0723 & 1.520 &" in text
    assert r"\cmidrule(lr){6-7} \cmidrule(lr){8-9}" in text
    assert text.count(r"\\") == 2 + len(table.rows)
    body = [line for line in text.splitlines() if line.endswith(r"\\")]
    widths = [len(re.findall(r"(?<!\\)&", line)) for line in body[1:]]
    assert set(widths) == {8}


@pytest.mark.parametrize("name", NASTY)
def test_html_shows_a_name_as_it_is(name: str) -> None:
    table = Table("x", (Column("Vehicle"),), ((name,),)).coloured(["#123456"])
    read_back = read_html(table.to_html())
    assert read_back.rows[1] == [name]
    assert "script" not in read_back.elements
    caption = read_html(Table(name, (Column(name),), ((name,),)).to_html())
    assert "script" not in caption.elements


@given(st.text(st.characters(codec="utf-8", exclude_characters="\r\n"), max_size=30))
def test_any_name_survives_html_and_csv(name: str) -> None:
    table = Table("", (Column("Vehicle"), Column("α", digits=2)), ((name, 1.0),))
    assert read_html(table.to_html()).elements == {
        "figure", "div", "table", "thead", "tr", "th", "tbody", "td",
    }  # fmt: skip
    assert list(csv_format.reader(io.StringIO(table.to_csv())))[1][0].removeprefix("'") == (
        name.removeprefix("'")
    )


@pytest.mark.parametrize("text", ["=1+1", "+1+cmd|' /C calc'!A0", "-2+3", "@SUM(A1)", "\t=1", "-x"])
def test_no_text_is_a_formula_to_a_spreadsheet(text: str) -> None:
    table = Table("", (Column("Vehicle"), Column("τ", digits=2)), ((text, -1.5),))
    assert list(csv_format.reader(io.StringIO(table.to_csv())))[1] == [f"'{text}", "-1.5"]


@pytest.mark.parametrize("text", ["-0.12", "+1.2", "-0.10 to 0.20", "-1.0 or more", "2 Tesla"])
def test_numbers_in_words_stay_as_they_are(text: str) -> None:
    table = Table("", (Column("Vehicle"),), ((text,),))
    assert list(csv_format.reader(io.StringIO(table.to_csv())))[1] == [text]


def test_a_long_name_is_whole_in_the_cells_title() -> None:
    name = 'A "very" long name of a vehicle'
    table = Table("", (Column("Vehicle"),), ((name,), ("2 Tesla",)))
    assert table.to_html().count(" title=") == 1
    assert 'title="A &quot;very&quot; long name of a vehicle"' in table.to_html()


@pytest.mark.parametrize(
    ("text", "shown"),
    [("a\n\nb", "a  b"), ("[x]", "{}[x]"), ("\u202ea", "(U+202E)a"), ("😀", "(U+1F600)"),
     ("Škoda é", "Škoda é")],
)  # fmt: skip
def test_latex_is_stopped_by_no_name(text: str, shown: str) -> None:
    assert latex(text) == shown


@pytest.mark.parametrize("name", NASTY)
def test_latex_reads_nothing_of_a_name(name: str) -> None:
    shown = latex(name)
    commands = set(re.findall(r"\\[a-zA-Z]+", shown))
    assert commands <= {r"\textbackslash", r"\textasciitilde", r"\textasciicircum",
                        r"\textless", r"\textgreater"}  # fmt: skip
    bare = re.sub(r"\\[a-zA-Z]+\{\}|\\[{}$&#%_]", "", shown)
    assert not set(bare) & set("\\{}$&#%_^~<>")


def test_a_dash_stands_for_what_does_not_exist() -> None:
    column = Column("τ", "s", 3)
    assert column.shown(None) == column.shown(float("nan")) == column.shown(float("inf")) == ABSENT
    assert column.shown(1.5204) == "1.520"
    assert column.heading == "τ [s]"
