"""The page Snapshots and what a snapshot restores on all others, without a browser."""

from dataclasses import replace
from typing import Any

import pytest
from streamlit.testing.v1 import AppTest

from accpinn.methods.fit import Outcome, StartedFrom
from accpinn.methods.pinn.config import PAPER, preset
from accpinn.methods.pinn.method import WarmStart
from accpinn.model.cthp import Parameters
from accpinn.recordings.recording import Recording
from accpinn.results.snapshot.saved import Library
from accpinn.results.snapshot.schema import Snapshot
from accpinn.tasks.task import Status
from pages.ui.components.parameter_picker import parameters_from
from pages.ui.data.sources import FIRST_SAMPLE, sample
from pages.ui.session import sessions
from pages.ui.session.resources import library, task_queue
from pages.ui.session.workspace import Workspace
from pages.ui.snapshots.differences import differing_settings, other_vehicles, parameter_differences
from pages.ui.train.settings import chosen_config
from tests.support.apptest import (
    COMPARE,
    DATA,
    PAGES,
    PLATOON,
    SNAPSHOTS,
    STABILITY,
    TRAIN,
    figures,
    open_page,
    plain,
    texts,
    with_sample,
    workspace_of,
)
from tests.support.methods import train
from tests.support.snapshots import whole

pytestmark = pytest.mark.usefixtures("fresh_server")


def button(page: AppTest, key: str) -> Any:
    return next(b for b in page.button if b.key == key)


def bare() -> Snapshot:
    """The same without its data."""
    return replace(whole(), segment=None, name="bare")


def recording() -> Recording:
    return sample(FIRST_SAMPLE)[0]


def with_fit() -> Workspace:
    found = with_sample()
    found.train(preset("fast", iterations=20))
    assert found.training is not None
    assert found.training.wait(120)
    assert found.training.status is Status.DONE
    return found


class TestSaving:
    def test_a_result_is_kept_and_listed(self) -> None:
        found = with_fit()
        page = open_page(SNAPSHOTS, found)
        page.text_input(key="snapshots_name").input("<b>mine</b>")
        page.text_area(key="snapshots_note").input("first try")
        next(b for b in page.button if b.label == "Save").click().run()
        assert not page.exception
        assert "Saved as" in plain(page)
        assert "“\\<b\\>mine" in texts(page)
        (entry,) = library().entries()
        assert (entry.name, entry.note, entry.with_data) == ("<b>mine</b>", "first try", False)
        assert "&lt;b&gt;mine&lt;/b&gt;" in plain(page)
        assert "<b>mine</b>" not in texts(page)
        kept = library().open(entry.id)
        assert found.fit is not None
        assert kept.fit.parameters.values.tobytes() == found.fit.parameters.values.tobytes()

    def test_data_go_in_only_when_asked(self) -> None:
        page = open_page(SNAPSHOTS, with_fit())
        assert not page.checkbox(key="snapshots_with_data").value
        page.checkbox(key="snapshots_with_data").check()
        next(b for b in page.button if b.label == "Save").click().run()
        assert library().entries()[0].with_data

    def test_what_is_known_of_the_recording_survives_saving_again(self) -> None:
        facts = {"campaign": "Ispra", "date": "2019-04-01", "acc_flag": 1}
        page = open_page(SNAPSHOTS, snapshot=library().add(replace(whole(), facts=facts)))
        page.text_input(key="snapshots_name").input("again")
        next(b for b in page.button if b.label == "Save").click().run()
        (again,) = (entry for entry in library().entries() if entry.name == "again")
        kept = library().open(again.id).facts
        assert {name: kept[name] for name in facts} == facts

    def test_without_a_result_there_is_a_way_to_one(self) -> None:
        page = open_page(SNAPSHOTS)
        assert "no result to save yet" in plain(page)
        assert "No snapshot is kept here yet" in plain(page)

    def test_a_stopped_training_is_called_so(self) -> None:
        fit = replace(whole().fit, outcome=Outcome.STOPPED, iterations=7)
        page = open_page(SNAPSHOTS, snapshot=library().add(replace(whole(), fit=fit)))
        assert "stopped at 7 of 20 iterations" in plain(page)

    def test_a_full_store_says_so(self) -> None:
        found = with_fit()
        page = open_page(SNAPSHOTS, found)
        library().cap_count = 0
        next(b for b in page.button if b.label == "Save").click().run()
        assert "is full" in plain(page)


class TestList:
    def test_open_delete_and_verify(self) -> None:
        name = library().add(whole())
        page = open_page(SNAPSHOTS)
        assert f"/Snapshots?snapshot={name}" in page.code[0].value
        assert "The snapshot is whole" in plain(page)
        assert "Recomputed" in plain(page)
        assert "the same" in plain(page)
        button(page, "snapshots_open").click().run()
        assert workspace_of(page).snapshot is not None
        assert "From the snapshot" in plain(page)
        button(page, "snapshots_delete").click().run()
        assert not page.exception
        assert library().entries() == ()

    def test_stands_at_the_one_that_is_open_then_at_the_one_just_saved(self) -> None:
        name = library().add(replace(whole(), name="old", created="2026-01-01T00:00:00Z"))
        library().add(whole())
        page = open_page(SNAPSHOTS, snapshot=name)
        assert page.selectbox(key="snapshots_chosen").value == name
        next(b for b in page.button if b.label == "Save").click().run()
        kept = page.selectbox(key="snapshots_chosen").value
        assert f"Saved as snapshot {kept}" in plain(page)
        assert not page.warning

    def test_one_deleted_elsewhere_can_be_kept_again(self) -> None:
        name = library().add(whole())
        page = open_page(TRAIN, snapshot=name)
        assert "deleted from the server" not in plain(page)
        library().delete(name)
        page.run()
        assert "deleted from the server" in plain(page)
        button(page, "snapshots_keep").click().run()
        assert "deleted from the server" not in plain(page)
        assert library().has(name)

    def test_the_methods_are_run_again_on_demand(self) -> None:
        library().add(whole())
        page = open_page(SNAPSHOTS)
        assert "finds these parameters" in plain(page)
        page.toggle(key="snapshots_again").set_value(True).run()
        assert "finds these parameters" not in plain(page)
        assert "Method run again, Recursive" in plain(page)

    def test_a_damaged_one_is_named_and_can_be_deleted(self) -> None:
        name = library().add(whole())
        path = library().folder / f"{name}.accpinn.zip"
        path.write_bytes(path.read_bytes()[:-9])
        page = open_page(SNAPSHOTS)
        assert "(damaged)" in plain(page)
        assert page.error
        button(page, "snapshots_delete").click().run()
        assert library().entries() == ()

    def test_two_side_by_side(self) -> None:
        library().add(whole())
        fit = replace(whole().fit, config={**whole().fit.config, "seed": 7})
        library().add(replace(whole(), name="other seed", fit=fit))
        page = open_page(SNAPSHOTS)
        page.toggle(key="snapshots_compare").set_value(True).run()
        assert not page.exception
        assert len(figures(page)) == 1
        assert "What differs" in plain(page)


def test_differences_are_those_of_the_second_against_the_first() -> None:
    one = whole()
    values = one.fit.parameters.values.copy()
    values[0, 0] *= 1.5
    other = replace(one, fit=replace(one.fit, parameters=Parameters.of(values)))
    table = parameter_differences(one, other)
    assert table.rows[0][-1] == "+50.0"
    assert [row[-1] for row in table.rows[1:]] == ["+0.0"] * (3 * one.info.followers - 1)
    assert differing_settings(one, one).rows == ()


def test_unlike_vehicles_are_not_compared_without_a_word() -> None:
    one = whole()
    assert other_vehicles(one, one) == ""
    names = (one.info.names[0], "Lada", *one.info.names[2:])
    said = other_vehicles(one, replace(one, info=replace(one.info, names=names)))
    assert f"{one.info.labels[1]} stands beside 2 Lada." in said
    assert said.count("stands beside") == 1


class TestLink:
    @pytest.mark.parametrize("path", PAGES)
    def test_opens_on_every_page_with_its_data(self, path: str) -> None:
        name = library().add(whole())
        page = open_page(path, snapshot=name)
        assert not page.error
        assert workspace_of(page).snapshot is not None
        assert workspace_of(page).segment is not None

    @pytest.mark.parametrize("path", PAGES)
    def test_opens_on_every_page_without_its_data(self, path: str) -> None:
        name = library().add(bare())
        page = open_page(path, snapshot=name)
        assert not page.error
        assert workspace_of(page).fit is not None

    @pytest.mark.parametrize("name", ["0" * 16, "../../etc"])
    def test_to_nothing_says_so(self, name: str) -> None:
        page = open_page(TRAIN, snapshot=name)
        assert "There is no snapshot" in plain(page)

    def test_in_a_session_that_exists(self) -> None:
        found, name = with_fit(), library().add(bare())
        page = open_page(TRAIN, found, snapshot=name)
        assert workspace_of(page) is found
        assert found.snapshot is not None
        assert found.snapshot.id == name

    def test_gives_way_to_what_is_opened_later(self) -> None:
        first, second = library().add(bare()), library().add(replace(bare(), name="second"))
        page = open_page(TRAIN, snapshot=first)
        found = workspace_of(page)
        found.restore(library().open(second))
        for stale in (second, first):  # the browser may send the old address once more
            page.query_params["snapshot"] = stale
            page.run()
            assert found.snapshot is not None
            assert found.snapshot.name == "second"
            assert page.query_params["snapshot"] in (second, [second])

    def test_opened_again_after_other_work_it_is_shown_again(self) -> None:
        found, name = with_fit(), library().add(bare())
        open_page(TRAIN, found, snapshot=name)
        found.open(replace(recording(), sha256="0" * 64))
        open_page(TRAIN, found, snapshot=name)
        assert found.snapshot is not None

    def test_a_reload_leaves_a_training_from_its_weights_alone(self) -> None:
        found, name = with_sample(), library().add(whole())
        open_page(TRAIN, found, snapshot=name)
        found.train(preset("fast", iterations=20), found.warm)
        open_page(TRAIN, found, snapshot=name)
        assert found.training is not None


class TestRestoring:
    def test_with_data_all_pages_have_their_figures(self) -> None:
        name = library().add(whole())
        assert len(figures(open_page(DATA, snapshot=name))) >= 1
        assert len(figures(open_page(TRAIN, snapshot=name))) == 5
        assert len(figures(open_page(STABILITY, snapshot=name))) == 3
        assert "Least squares" in plain(open_page(COMPARE, snapshot=name))
        page = open_page(TRAIN, snapshot=name)
        (table, *_) = [e.proto.body for e in page.get("html") if "<table" in e.proto.body]
        assert f"{whole().fit.parameters[0].alpha:.4f}" in table

    def test_without_data_the_recording_is_named(self) -> None:
        name, info = library().add(bare()), whole().info
        for path in (DATA, COMPARE, TRAIN):
            assert info.sha256 in plain(open_page(path, snapshot=name)), path
        page = open_page(TRAIN, snapshot=name)
        assert len(figures(page)) == 5, "history and the network's curves are in the snapshot"
        assert len(figures(open_page(STABILITY, snapshot=name))) == 3

    def test_the_recording_completes_it(self) -> None:
        found = sessions.workspaces().new()
        found.restore(library().open(library().add(bare())))
        assert found.segment is None
        found.open(*sample(FIRST_SAMPLE))
        assert found.snapshot is not None
        assert found.segment is not None
        assert found.segment.info.digest == whole().info.digest
        assert found.fit is found.snapshot.fit

    def test_another_recording_takes_its_place(self) -> None:
        found = sessions.workspaces().new()
        found.restore(library().open(library().add(bare())))
        found.open(replace(recording(), sha256="0" * 64))
        assert found.snapshot is None
        assert found.fit is None

    def test_a_choice_lets_it_go_for_good(self) -> None:
        name = library().add(whole())
        page = open_page(TRAIN, snapshot=name)
        found = workspace_of(page)
        found.open(replace(recording(), sha256="0" * 64))
        page.run()
        assert found.snapshot is None
        assert "snapshot" not in page.query_params

    def test_training_goes_on_from_its_weights(self) -> None:
        name = library().add(whole())
        page = open_page(TRAIN, snapshot=name)
        button(page, "train_warm").click().run()
        found = workspace_of(page)
        assert found.training is not None
        assert found.training.wait(120)
        fit = found.fit
        assert fit is not None
        assert fit.history is not None
        assert StartedFrom(f"snapshot {name}") in fit.findings
        assert fit.history.total[0] == pytest.approx(whole().fit.loss["total"], rel=1e-6)

    def test_a_stopped_one_goes_on_from_the_same_weights(self) -> None:
        found = sessions.workspaces().new()
        found.restore(library().open(library().add(whole())))
        assert found.segment is not None
        config = replace(PAPER, iterations=100_000)
        early = train(found.segment, "II", replace(PAPER, iterations=1), threads=1)
        found.train(config, WarmStart.of(early, "another snapshot"))
        found.preset, found.settings["paper"] = "paper", config.changes()
        job = found.training
        assert job is not None
        while job.progress is None or job.progress.iteration < 2:
            assert not job.wait(0.01)
        task_queue().stop(job)
        assert job.wait(60)
        page = open_page(TRAIN, found)
        assert "Continue from iteration" in button(page, "train_start").label
        button(page, "train_start").click().run()
        assert found.training is not None
        assert found.training is not job
        assert found.training.request.warm is job.request.warm
        task_queue().stop(found.training)
        assert found.training.wait(60)
        page.run()
        button(page, "train_anew").click().run()
        assert found.training.request.warm is None
        task_queue().stop(found.training)

    def test_goes_on_with_the_settings_it_was_trained_with(self) -> None:
        page = open_page(TRAIN, snapshot=library().add(whole()))
        found = workspace_of(page)
        assert chosen_config(found).to_json() == whole().fit.config
        button(page, "train_warm").click().run()
        assert found.training is not None
        assert found.training.request.config.iterations == 20
        assert "the training is new" in plain(page)

    def test_without_the_data_no_training_is_offered(self) -> None:
        page = open_page(TRAIN, snapshot=library().add(bare()))
        assert not [b for b in page.button if b.key in ("train_warm", "train_start")]


class TestParameters:
    @pytest.mark.parametrize("path", [STABILITY, PLATOON])
    def test_a_snapshot_is_a_source(self, path: str) -> None:
        found = sessions.workspaces().new()
        found.parameter_choice.source = "snapshot"
        known = whole().fit.parameters
        changed = Parameters(0.05 + 0 * known.alpha, known.beta, known.tau)
        other = replace(whole(), name="other", fit=replace(whole().fit, parameters=changed))
        name, _ = library().add(other), library().add(whole())
        found.parameter_choice.snapshot = name
        page = open_page(path, found)
        assert not page.error
        assert parameters_from(found, "snapshot").parameters == changed

    @pytest.mark.parametrize("path", [STABILITY, PLATOON])
    def test_a_run_looks_at_the_shelf_once_and_reads_a_snapshot_once(
        self, path: str, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        found = sessions.workspaces().new()
        found.parameter_choice.source, found.parameter_choice.snapshot = (
            "snapshot",
            library().add(whole()),
        )
        looks, reads = [], []
        entries, opening = Library.entries, Library.open
        monkeypatch.setattr(Library, "entries", lambda s: looks.append(1) or entries(s))
        page = open_page(path, found)
        monkeypatch.setattr(Library, "open", lambda s, name: reads.append(name) or opening(s, name))
        looks.clear()
        page.run()
        assert (len(looks), reads) == (1, [])

    def test_one_deleted_meanwhile_gives_way_to_another_source(self) -> None:
        found = sessions.workspaces().new()
        found.parameter_choice.source, found.parameter_choice.snapshot = (
            "snapshot",
            library().add(whole()),
        )
        library().delete(found.parameter_choice.snapshot)
        page = open_page(STABILITY, found)
        assert not page.error
        assert page.get("plotly_chart")
