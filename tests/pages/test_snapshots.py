"""The page Snapshots and what a snapshot restores on all others, without a browser."""

import html
from dataclasses import replace

import pytest

from accpinn import Parameters
from accpinn.tasks import Status, Task
from pages.ui.session import saved, sessions, users
from pages.ui.session.resources import library, task_queue
from pages.ui.snapshots.listing import differences_table, other_vehicles, what_differs
from pages.ui.snapshots.page import suggested_name
from tests.support.apptest import PAGES, WAIT, fitted, open_page, sample_recording, stop_tasks
from tests.support.snapshots import altered, whole

pytestmark = pytest.mark.usefixtures("fresh_server")


class TestSaving:
    def test_a_result_is_kept_with_its_data_which_is_said_first(self) -> None:
        session = fitted()
        page = open_page("Snapshots", session)
        assert "contains the recorded speeds and gaps" in page.plain()
        page.text_input(key="snapshots_name").input("<b>mine</b>")
        page.text_input(key="snapshots_note").input("first try")
        page.press("Save")
        (entry,) = library().entries()
        assert (entry.name, entry.note) == ("<b>mine</b>", "first try")
        assert "first try" in page.plain(), "the result that was saved is shown"
        kept = library().read(entry.id)
        assert (
            kept.parameters.everything.tobytes() == session.result.parameters.everything.tobytes()
        )
        assert [one.info.digest for one in kept.segments] == [session.segment.info.digest]

        assert page.boxes("success")
        page.press("snapshots_back")
        assert not page.boxes("success"), "it was said of the snapshot that was left"
        assert page.button(key=f"snapshots_open_{entry.id}").label == "\\<b\\>mine\\<\\/b\\>"
        page.press("Save")
        assert suggested_name(session) in [one.name for one in library().entries()]
        page.press("snapshots_back")
        library().cap_count = 0
        page.text_input(key="snapshots_name").input("one more")
        assert "is full" in page.press("Save").plain()


class TestList:
    def test_a_row_opens_the_result_which_is_verified_and_opened_on_every_page(self) -> None:
        name = library().add(whole())
        page = open_page("Snapshots")
        page.press(f"snapshots_open_{name}")
        assert f"/Snapshots?snapshot={name}" in page.code[0].value
        assert page.workspace().restored is None, "looking at it changes nothing"
        page.open_tab("snapshots_tabs", "Verify")
        assert "Not verified yet" in page.plain()
        page.press("snapshots_again")
        assert page.workspace().verifications[name].wait(WAIT)
        page.sound()
        checked = library().verification(name)
        assert checked.ok
        for kept in (page, open_page("Snapshots", snapshot=name)):
            assert checked.sentence in kept.plain(), "also for the next visitor"
            assert "snapshots_again" not in kept.buttons
        page.press("snapshots_open")
        assert page.workspace().restored is not None
        assert "snapshots_open" not in page.buttons

    def test_a_mark_says_how_it_was_verified_and_a_failure_stays_too(self) -> None:
        forged = altered(whole(), parameters=Parameters.of(whole().parameters.values * 1.1))
        name = library().add(replace(forged, compared=()))
        page = open_page("Snapshots", snapshot=name)
        page.press("snapshots_again")
        assert page.workspace().verifications[name].wait(WAIT)
        assert library().verification(name).ok is False
        for kept in (page.sound(), open_page("Snapshots", snapshot=name)):
            (said,) = kept.boxes("error")
            assert "stored α" in said
        listed = page.press("snapshots_back").plain()
        assert library().verification(name).brief in listed
        assert said in html.unescape(listed), "on hover"

    def test_once_the_recording_is_open_its_data_are_compared_too(self) -> None:
        name = library().add(whole())
        session = sessions.workspaces().new()
        session.viewed = name
        page = open_page("Snapshots", session).press("snapshots_again")
        assert session.verifications[name].wait(WAIT)
        assert "snapshots_again" not in page.sound().buttons
        session.open(sample_recording())
        page.sound().press("snapshots_again")
        assert session.verifications[name].wait(WAIT)
        assert library().verification(name).has_recording
        assert "snapshots_again" not in page.sound().buttons

    def test_a_verification_is_stopped_and_leaves_no_mark(self) -> None:
        name = library().add(whole())
        page = open_page("Snapshots", snapshot=name)
        held = Task("somebody", "training", lambda context: iter(iter(context.should_stop, True)))
        task_queue().submit(held)
        page.press("snapshots_again")
        page.press("snapshots_verify_stop")
        held.stop()
        assert page.workspace().verifications[name].status is Status.STOPPED
        assert library().verification(name) is None
        assert "snapshots_again" in page.sound().buttons

    def test_words_find_rows(self) -> None:
        for name in ("alfa", "bravo", "charlie", "delta", "echo", "foxtrot"):
            library().add(replace(whole(), name=name))
        page = open_page("Snapshots")
        page.text_input(key="snapshots_search").input("BRAVO").run()
        shown = [b.label for b in page.button if (b.key or "").startswith("snapshots_open_")]
        assert shown == ["bravo"]

    def test_one_deleted_elsewhere_can_be_kept_again(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(users, "is_shared", lambda: True)
        name = library().add(whole())
        page = open_page("Train", snapshot=name)
        assert "deleted from the server" not in page.plain()
        library().delete(name)
        page.run()
        assert "deleted from the server" in page.plain()
        assert "deleted from the server" not in page.press("snapshots_keep").plain()
        assert library().has(name)
        assert saved.may_delete(page.workspace().id, name), "whoever keeps it"

    def test_a_damaged_one_is_named_and_can_be_deleted_and_imported_anew(self) -> None:
        name = library().add(whole())
        path = library().folder / f"{name}.accpinn.zip"
        sound = path.read_bytes()
        path.write_bytes(sound[:-9])
        page = open_page("Snapshots")
        assert "damaged" in page.plain()
        assert page.press(f"snapshots_open_{name}").error
        page.press("snapshots_back").press(f"snapshots_delete_{name}")
        assert library().entries() == ()
        page.file_uploader(key="snapshots_upload").upload("it.accpinn.zip", sound).run()
        assert f"it.accpinn.zip is whole and now kept as {name}" in page.plain()


class TestTwo:
    def test_side_by_side(self) -> None:
        library().add(whole())
        asked = whole().analysis
        asked = replace(asked, settings=asked.settings | {"seed": 7})
        other = altered(replace(whole(), analysis=asked), settings=asked.settings)
        name = library().add(replace(other, name="other seed"))
        page = open_page("Snapshots").press(f"snapshots_open_{name}")
        page.open_tab("snapshots_tabs", "Beside another")
        *_, curves = page.figures()
        drawn = {trace.get("name") for trace in curves["data"]}
        assert {"data", "first", "second"} <= drawn, "both simulations over the data"
        assert "seed: 7 → 0" in page.plain()

    def test_differences_are_those_of_the_second_and_unlike_vehicles_are_named(self) -> None:
        snapshot = whole()
        values = snapshot.parameters.values.copy()
        values[0, 0] *= 1.5
        other = altered(snapshot, parameters=Parameters.of(values))
        table = differences_table(snapshot, other)
        speed = snapshot.estimate.stated_speed
        gap, changed, *rest = (row[-1] for row in table.rows)
        assert float(table.rows[0][2].split()[0]) == pytest.approx(
            snapshot.estimate.time_gap(speed, 0).value, abs=0.006
        )
        assert (gap, changed, {*rest}) == ("0.0", "+50.0", {"0.0"})
        assert len(rest) == 4 * snapshot.info.followers - 2
        assert what_differs(snapshot, snapshot) == ()
        assert other_vehicles(snapshot, snapshot) == ""
        names = (snapshot.info.names[0], "Lada", *snapshot.info.names[2:])
        said = other_vehicles(
            snapshot, replace(snapshot, infos=(replace(snapshot.info, names=names),))
        )
        assert f"{snapshot.info.labels[1]} stands beside 2 Lada." in said


class TestLink:
    @pytest.mark.parametrize("title", PAGES)
    def test_opens_on_every_page_with_its_data(self, title: str) -> None:
        page = open_page(title, snapshot=library().add(whole()))
        assert not page.error
        session = page.workspace()
        assert session.restored is session.result
        assert session.segment.info.digest == whole().info.digest
        if title in ("Train", "Stability", "Snapshots"):
            assert page.figures(), "the network's curves are in the snapshot"
        if title == "Snapshots":
            assert not [key for key in page.buttons if "delete" in key or "save" in key]
            assert "From the snapshot" in page.press("snapshots_back").plain()
        if title == "Train":
            assert f"{whole().parameters[0].alpha:.4f}" in page.texts()
            assert "train_start" in page.buttons

    def test_what_takes_the_recording_asks_for_it(self) -> None:
        page = open_page("Compare", snapshot=library().add(whole()))
        page.choose("compare_view", "models")
        assert whole().analysis.source.sha256 in page.plain()

    def test_foreign_text_in_it_is_shown_as_it_is(self) -> None:
        image = "![x](http://evil.org/x.png)"
        (segment,) = whole().segments
        forged = replace(segment, excluded_regimes=(image,))
        snapshot = replace(whole(), segments=(forged,), infos=(forged.info,), compared=())
        page = open_page("Train", snapshot=library().add(snapshot))
        assert image in page.plain()
        written = [one.value for kind in ("markdown", "caption") for one in page.get(kind)]
        assert image not in "".join(written)

    @pytest.mark.parametrize("name", ["0" * 16, "../../etc"])
    def test_to_nothing_says_so(self, name: str) -> None:
        assert "There is no snapshot" in open_page("Train", snapshot=name).plain()

    def test_is_followed_in_a_session_that_exists_and_again_after_other_work(self) -> None:
        session, name = fitted(), library().add(whole())
        page = open_page("Train", session, snapshot=name)
        assert page.workspace() is session
        assert session.restored.id == name
        session.open(replace(sample_recording(), sha256="0" * 64))
        page.run()
        assert (session.restored, session.result) == (None, None), "for good"
        assert "snapshot" not in page.query_params
        open_page("Train", session, snapshot=name)
        assert session.restored is not None

    def test_gives_way_to_what_is_opened_later(self) -> None:
        first, second = library().add(whole()), library().add(replace(whole(), name="second"))
        page = open_page("Train", snapshot=first)
        session = page.workspace()
        session.restore(library().read(second))
        for stale in (second, first):  # the browser may send the old address once more
            page.query_params["snapshot"] = stale
            page.run()
            assert session.restored.name == "second"
            assert page.query_params["snapshot"] in (second, [second])


class TestRestoring:
    def test_the_recording_completes_it(self) -> None:
        session = sessions.workspaces().new()
        session.restore(library().read(library().add(whole())))
        assert session.recording is None
        session.open(sample_recording())
        assert session.segment.info.digest == whole().info.digest
        assert session.result is session.restored

    def test_its_data_are_trained_on_with_its_settings_and_nothing_is_lost(self) -> None:
        page = open_page("Train", snapshot=library().add(whole()))
        session = page.workspace()
        assert session.analysis().settings == whole().estimate.settings
        page.press("train_start")
        assert "it stays until the training that runs has a result" in page.plain()
        assert session.training.wait(120)
        assert session.result.parameters == whole().parameters
        assert session.result.analysis.key != whole().analysis.key, "nobody saw the recording"
        assert [entry.id for entry in session.runs] == [session.result.analysis.key]
        assert session.as_snapshot().facts == whole().facts, "as the snapshot knows them"
        session.compare()
        session.comparison.stop()
        session.preset = "paper"
        session.train()
        assert session.result is session.restored, "what was there stays while a training runs"
        stop_tasks(session)
        assert session.result.segment == session.segment, "the snapshot, or what was learned so far"
        assert len(session.runs) == 1
