"""Tables in five formats: the same cells, and nothing of a name interpreted."""

import csv
import io
import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from markdown_it import MarkdownIt

from accpinn.findings import probability
from accpinn.results.tables import ABSENT, Cell, Column, Range, Table, between, latex, percent_cells
from accpinn.units import Quantity
from tests.support.html import Reader

NASTY = ["<script>alert(1)</script>", "A&B_50%$x$^2", r"\input{secret}~#{}"]
INF, NAN = float("inf"), float("nan")
LEARNED = Column("x", digits=4)
TABLE = Table.of(
    "Two followers",
    [
        (Column("Follower"), ["2 BMW", "3 Tesla"]),
        (Column("α", "1/s²", 4, "90 % interval", key="alpha"), [Range(0.01, 0.02), None]),
        (Column("τ", "s", 3, "90 % interval", key="tau"), [Range(1.2, INF), Range(NAN, NAN)]),
        (Column("p", "m", 2, "Surrogate fit, MAE"), np.array([0.123456789, NAN])),
    ],
)


def read_csv(table: Table) -> list[list[str]]:
    return list(csv.reader(io.StringIO(table.to_csv())))


@pytest.mark.parametrize(
    ("column", "cell", "shown"),
    [
        *((Column("τ", "s", 3), cell, ABSENT) for cell in (None, NAN, INF)),
        (Column("τ", "s", 3), 1.5204, "1.520"),
        (Column("Time", "s", 2, least=True), 0.0, "0.00"),
        (Column("Time", "s", 2, least=True), 0.0004, "< 0.01"),
        (Column("Time", "s", 2, least=True), 0.006, "0.01"),
        (LEARNED, Quantity(0.014712, 0.0095, 0.0198), "0.0147 (0.0095–0.0198)"),
        (LEARNED, Quantity(0.0864, 0.057, 0.0921), "0.086 (0.057–0.092)"),
        (LEARNED, Quantity(1.5203, 1.29, 1.89), "1.52 (1.29–1.89)"),
        (LEARNED, Quantity(3.0, 0.0, 60.0), "3 (0–60)"),
        (LEARNED, Quantity(3.0, -0.4, 60.0), "3 (0–60)"),
        (LEARNED, Quantity(3.0, -0.6, 60.0), "3 (-1 to 60)"),
        (LEARNED, Quantity(1.5203, 1.29, INF), "1.52 (1.29 or more)"),
        (LEARNED, Quantity(0.2, NAN, NAN), "0.20 (–)"),
        (LEARNED, Quantity(NAN, 1.0, 1.4), "– (1.00–1.40)"),
        (Column.chance("Stable"), Quantity(0.0, 0.0, 57.0), "under 1 (0–57)"),
    ],
)
def test_a_cell_has_the_digits_that_it_supports(column: Column, cell: Cell, shown: str) -> None:
    assert column.shown(cell) == shown


@pytest.mark.parametrize(
    ("low", "high", "shown"),
    [(0.5, 1.25, "0.50 to 1.25"), (0.5, INF, "0.50 or more"), (-INF, 2.0, "up to 2.00"),
     (-INF, INF, "anything"), (NAN, INF, ABSENT)],
)  # fmt: skip
def test_an_interval_in_words(low: float, high: float, shown: str) -> None:
    assert between(low, high, 2) == shown


def test_a_probability_is_said_as_in_sentences_and_exact_in_csv() -> None:
    shares = (0.0, 0.004, 0.5, 0.99, 1.0)
    filled = (Column.chance("Stable"), percent_cells(shares))
    table = Table.of("", [(Column("Name"), "abcde"), filled])
    cells = [row.split(maxsplit=1)[1] for row in table.to_text().splitlines()[1:]]
    assert [f"{cell} %" for cell in cells] == [probability(share) for share in shares]
    assert [float(row[1]) for row in read_csv(table)[1:]] == [100 * share for share in shares]


def test_intervals_take_two_columns_of_a_csv_file_and_numbers_all_digits() -> None:
    assert read_csv(TABLE) == [
        ["follower", "alpha_low", "alpha_high", "tau_low", "tau_high", "surrogate_fit_mae_p_m"],
        ["2 BMW", "0.01", "0.02", "1.2", "inf", "0.123456789"],
        ["3 Tesla", "", "", "", "", ""],
    ]


@pytest.mark.parametrize(
    ("column", "name"),
    [
        (Column("Car-following", "%"), "car_following_percent"),
        (Column("Δv, std.", "m/s"), "delta_v_std_m_per_s"),
        (Column("α", "1/s²", group="Learned"), "learned_alpha_per_s2"),
        (Column("L₂", "%", group="Stability"), "stability_l2_percent"),
        (Column("τ", "s", key="tau"), "tau"),
    ],
)
def test_names_in_csv_are_words_joined_by_underscores(column: Column, name: str) -> None:
    assert column.csv_name == name


def test_no_text_in_csv_is_a_formula_to_a_spreadsheet() -> None:
    texts = ["=1+1", "+1+cmd|' /C calc'!A0", "-2+3", "@SUM(A1)", "\t=1", "-x"]
    numbers = ["-0.12", "+1.2", "2 Tesla"]
    table = Table.of(
        "", [(Column("Vehicle"), texts + numbers), (Column("τ", digits=2), 9 * [-1.5])]
    )
    assert read_csv(table)[1:] == [[text, "-1.5"] for text in (*(f"'{t}" for t in texts), *numbers)]


def test_latex_is_a_table_of_the_same_cells() -> None:
    text = TABLE.to_latex()
    for part in (
        r"\begin{tabular}{lrrr}",
        r"$\alpha$ [1/s$^2$]",
        r"2 BMW & 0.0100 to 0.0200 & 1.200 or more & 0.12 \\",
        r"\cmidrule(lr){2-3} \cmidrule(lr){4-4}",
    ):
        assert part in text
    assert text.count(r"\\") == 2 + len(TABLE.rows)
    assert "U+" not in latex("αβτΔλω∞₀₁₂²−≤‖")


@pytest.mark.parametrize(
    ("text", "shown"),
    [("a\n\nb", "a  b"), ("[x]", "{}[x]"), ("\u202ea", "(U+202E)a"), ("😀", "(U+1F600)"),
     ("Škoda é", "Škoda é")],
)  # fmt: skip
def test_latex_is_stopped_by_no_name(text: str, shown: str) -> None:
    assert latex(text) == shown


def test_markdown_is_a_table_of_the_same_cells() -> None:
    caption, _, heading, rule, first, _ = TABLE.to_markdown().splitlines()
    assert caption == TABLE.caption
    assert heading.startswith("| Follower | 90 % interval α \\[1/s²\\] | 90 % interval τ")
    assert rule == "| --- | ---: | ---: | ---: |"
    assert first == "| 2 BMW | 0.0100 to 0.0200 | 1.200 or more | 0.12 |"


@settings(max_examples=40)
@given(st.sampled_from([*NASTY, "&lt; a|b", "**a** `b`"]) | st.text(st.characters(codec="utf-8")))
def test_markdown_shows_a_name_as_it_is(name: str) -> None:
    table = Table("", (Column("Vehicle"), Column("α", digits=2)), ((name, 1.0),))
    page = Reader(MarkdownIt().enable("table").render(table.to_markdown()))
    assert {tag for tag, _ in page.tags} == {"table", "thead", "tbody", "tr", "th", "td"}
    assert page.rows[1] == [" ".join(name.split()), "1.00"]


@pytest.mark.parametrize("name", NASTY)
def test_latex_and_html_show_a_name_as_it_is(name: str) -> None:
    shown = latex(name)
    commands = set(re.findall(r"\\[a-zA-Z]+", shown))
    assert commands <= {r"\textbackslash", r"\textasciitilde", r"\textasciicircum", r"\textless",
                        r"\textgreater"}  # fmt: skip
    bare = re.sub(r"\\[a-zA-Z]+\{\}|\\[{}$&#%_]", "", shown)
    assert not set(bare) & set("\\{}$&#%_^~<>")
    read = Reader(Table(name, (Column(name),), ((name,),)).coloured(["#123456"]).to_html())
    assert read.rows == [[name], [name]]
    assert "script" not in [tag for tag, _ in read.tags]


@settings(max_examples=40)
@given(st.text(st.characters(codec="utf-8", exclude_characters="\r\n"), max_size=30))
def test_any_name_survives_html_and_csv(name: str) -> None:
    table = Table("", (Column("Vehicle"), Column("α", digits=2)), ((name, 1.0),))
    elements = {"figure", "div", "table", "thead", "tr", "th", "tbody", "td"}
    assert {tag for tag, _ in Reader(table.to_html()).tags} == elements
    assert read_csv(table)[1][0].removeprefix("'") == name.removeprefix("'")


def test_html_has_groups_headings_and_rows() -> None:
    assert Reader(TABLE.to_html()).rows[:3] == [
        ["", "90 % interval", "Surrogate fit, MAE"],
        ["Follower", "α [1/s²]", "τ [s]", "p [m]"],
        ["2 BMW", "0.0100 to 0.0200", "1.200 or more", "0.12"],
    ]
