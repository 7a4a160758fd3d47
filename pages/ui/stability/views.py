"""The answer in words, the table with its downloads, and the reasons on demand."""

import re
from math import isinf

import streamlit as st

from accpinn.inference.intervals import Uncertainty
from accpinn.model.published import ParameterSet
from accpinn.results.figures import stability as figures
from accpinn.results.messages.stability import BEHAVIOURS, TITLES, reason
from accpinn.results.tables import table as typeset
from accpinn.results.tables.stability import answer, stability_table
from accpinn.stability.report import StabilityReport, VehicleStability, Verdict
from pages.ui.components.text import escape_markdown
from pages.ui.stability.certainty import certainty

NUMBERS = ("no", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten")


def show_answer(
    laws: ParameterSet, report: StabilityReport, uncertainty: Uncertainty | None
) -> None:
    """Who amplifies, how sure that is, the platoon, and where the two L∞ criteria disagree."""
    with st.container(border=True):
        st.markdown(f"#### {headline(laws, report)}")
        if uncertainty:
            st.markdown(certainty(laws, report, uncertainty))
        if len(laws) > 1:
            st.markdown(platoon_line(report))
    wrong = [
        f"**{escape_markdown(label)}: L∞ stable by the paper's criterion, not by the exact one.**"
        f" {escape_markdown(reason(vehicle.linf_exact, vehicle))}"
        for label, vehicle in zip(laws.labels, report.vehicles, strict=True)
        if vehicle.linf_paper.stable and not vehicle.linf_exact.stable
    ]
    if wrong:
        st.warning("  \n".join(wrong), icon=":material/warning:")


def headline(laws: ParameterSet, report: StabilityReport) -> str:
    """One sentence: how many amplify, and which most."""
    who = [k for k, vehicle in enumerate(report.vehicles) if not vehicle.l2.stable]
    count, total = len(who), len(laws)
    if not who:
        growing = [v for v in report.vehicles if not v.linf_exact.stable]
        peaks = " But peaks can still grow: see the L∞ gain." if growing else ""
        if total == 1:
            return (
                f"{_first(escape_markdown(laws.spoken[0]))} does not amplify any frequency.{peaks}"
            )
        return f"None of the vehicles amplifies any frequency.{peaks}"
    worst = max(who, key=lambda k: report.vehicles[k].peak.gain)
    peak = report.vehicles[worst].peak
    name = escape_markdown(laws.spoken[worst])
    extent = "without limit" if isinf(peak.gain) else f"up to {peak.gain:.3g} times"
    most = f"{extent} at {peak.omega:.3g} rad/s"
    if total == 1:
        return f"{_first(name)} amplifies disturbances {most}."
    if count == 1:
        return f"One of {_number(total)} vehicles amplifies disturbances: {name}, {most}."
    start = f"All {_number(total)}" if count == total else f"{_number(count)} of {_number(total)}"
    return f"{_first(start)} vehicles amplify disturbances, {name} the most: {most}."


def platoon_line(report: StabilityReport) -> str:
    """The verdicts on the whole platoon, weak and strict, in one line."""
    platoon = report.platoon
    questions = (
        ("Strictly stable (nothing grows at any vehicle)", platoon.l2_strict, platoon.linf_strict),
        ("Weakly stable (nothing has grown at the last one)", platoon.l2_weak, platoon.linf_weak),
    )
    parts = [f"{name}: L₂ **{answer(l2)}**, L∞ **{answer(linf)}**." for name, l2, linf in questions]
    why = escape_markdown(reason(platoon.l2_weak, report))
    return f"The platoon in this order. {' '.join(parts)} {why}"


def show_table(laws: ParameterSet, report: StabilityReport) -> None:
    """As the paper's Table III, with the exact gain beside its criterion."""
    table = stability_table(laws, report)
    st.html(typeset.STYLE + table.coloured(figures.colours(laws)).to_html())
    st.caption(
        "‖h‖₁: how many times larger a peak of the speed deviation can come out than it came in."
        " Stable from τ: the smallest time headway at which this vehicle, with its α and β, would"
        " be stable."
    )
    name = re.sub(r"\W+", "_", laws.title).strip("_").lower()
    with st.container(horizontal=True):
        for label, text, ending, mime in (
            ("CSV", table.to_csv(), "csv", "text/csv"),
            ("LaTeX", table.to_latex(), "tex", "application/x-tex"),
        ):
            st.download_button(
                label, text, f"stability_{name}.{ending}", mime, key=f"stability_{ending}",
                on_click="ignore", icon=":material/download:",
            )  # fmt: skip


def show_reasons(laws: ParameterSet, report: StabilityReport) -> None:
    """A sentence for every verdict."""
    with st.expander("Why: a sentence for every verdict", icon=":material/help:"):
        for label, vehicle in zip(laws.labels, report.vehicles, strict=True):
            verdicts: tuple[Verdict, ...] = (vehicle.l2, vehicle.linf_paper, vehicle.linf_exact)
            st.markdown(
                f"**{escape_markdown(label)}.** {BEHAVIOURS[vehicle.behaviour]}\n"
                + _listed(verdicts, vehicle)
            )
        if len(laws) > 1:
            platoon = report.platoon
            verdicts = (platoon.l2_strict, platoon.l2_weak,
                        platoon.linf_strict, platoon.linf_weak)  # fmt: skip
            followers = ", ".join(f"{k} {name}" for k, name in enumerate(laws.names, 1))
            counted = f"Followers are counted from the leader on: {escape_markdown(followers)}."
            st.markdown(f"**The platoon.** {counted}\n" + _listed(verdicts, report))


def _listed(verdicts: tuple[Verdict, ...], of: VehicleStability | StabilityReport) -> str:
    return "".join(
        f"\n- {TITLES[verdict.criterion]}: **{answer(verdict)}**."
        f" {escape_markdown(reason(verdict, of))}"
        for verdict in verdicts
    )


def _first(words: str) -> str:
    """The beginning of a sentence."""
    return words[:1].upper() + words[1:]


def _number(count: int) -> str:
    return NUMBERS[count] if count < len(NUMBERS) else str(count)
