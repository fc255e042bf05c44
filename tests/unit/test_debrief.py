"""A flight's folder and its result.json: nobody else's, nothing old, nothing lost."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest

from app.debrief import clear, failed, files_of, own_folder, review, set_aside, write_result
from app.errors import AlightError
from app.flying import Ended, Flown, Plan


def plan(folder: Path | None) -> Plan:
    return Plan("static", None, folder)  # type: ignore[arg-type]  # a stand-in


def test_own_folder_is_made_and_kept_with_what_is_in_it(tmp_path):
    with own_folder(tmp_path / "a" / "b") as folder:
        (folder / "file").touch()
    assert (tmp_path / "a" / "b" / "file").exists()


def test_own_folder_that_stayed_empty_is_taken_away(tmp_path):
    with own_folder(tmp_path / "a"):
        pass
    assert not (tmp_path / "a").exists()


def test_own_folder_of_another_flight_is_an_error_until_that_ends(tmp_path):
    (tmp_path / "file").touch()
    with own_folder(tmp_path):
        with (
            pytest.raises(AlightError, match="another Alight writes there; give"),
            own_folder(tmp_path),
        ):
            pass
        with own_folder(tmp_path / "deeper"):
            pass
    with own_folder(tmp_path):
        pass


@pytest.mark.parametrize("name", ["file", "file/deeper"])
def test_own_folder_where_a_file_is_is_an_error(tmp_path, name):
    (tmp_path / "file").touch()
    with pytest.raises(AlightError, match=r"file.*: can't be made"), own_folder(tmp_path / name):
        pass


def test_clear_removes_what_is_there_and_minds_nothing_missing(tmp_path):
    (tmp_path / "a").touch()
    clear(tmp_path / "a", tmp_path / "b")
    assert list(tmp_path.iterdir()) == []


def test_clear_of_what_cannot_be_removed_is_an_error(tmp_path):
    (tmp_path / "a").mkdir()
    with pytest.raises(AlightError, match="can't be replaced"):
        clear(tmp_path / "a")


def test_set_aside_keeps_an_earlier_record_under_the_time_it_was_written(tmp_path):
    record = tmp_path / "flight.mcap"
    record.write_text("precious")
    os.utime(record, (1_700_000_000, 1_700_000_000))  # 2023-11-14 22:13:20 UTC
    set_aside(*files_of(plan(tmp_path)))
    (kept,) = tmp_path.iterdir()
    assert (kept.name, kept.read_text()) == ("flight-2023-11-14T22-13-20Z.mcap", "precious")


def test_result_is_written_whole_as_json(tmp_path):
    found = write_result(tmp_path, [{"name": "static", "touchdown_error_m": None}])
    assert json.loads((tmp_path / "result.json").read_text()) == found
    assert found == {"experiments": [{"name": "static", "touchdown_error_m": None}]}
    assert [p.name for p in tmp_path.iterdir()] == ["result.json"]


def test_result_that_cannot_be_written_is_an_error_and_leaves_the_old_one(tmp_path):
    write_result(tmp_path, [])
    (tmp_path / "result.part").mkdir()
    with pytest.raises(AlightError, match=r"result\.json: can't be written"):
        write_result(tmp_path, [{"name": "static"}])
    assert json.loads((tmp_path / "result.json").read_text()) == {"experiments": []}


def test_review_of_a_flight_without_a_record_was_not_flown(tmp_path):
    _, entry = review(plan(None), Flown(Ended.OVER, {"application": 12.5}))
    assert (entry["outcome"], entry["cpu_percent"]) == ("not flown", {"application": 12.5})


def test_failed_flight_without_a_record_has_every_key_and_its_error(tmp_path):
    error = AlightError("the simulator didn't start", "mend that")
    entry = failed(plan(tmp_path), error)
    assert (entry["name"], entry["outcome"], entry["reason"]) == ("static", "failed", str(error))
    assert set(entry) == set(review(plan(None), Flown(Ended.OVER))[1])


def test_failed_flight_tells_as_much_as_its_truth_holds(tmp_path):
    from mcap.writer import Writer

    with (tmp_path / "flight.mcap").open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        writer.finish()
    (tmp_path / "truth.jsonl").write_text('{"kind": "start", "seed": 5, "vehicle": "built-in"}\n')
    entry = failed(plan(tmp_path), AlightError("the link was lost", "look"))
    assert (entry["outcome"], entry["reason"], entry["seed"]) == ("failed", "the link was lost; look", 5)


def test_own_folder_that_was_there_before_stays_though_empty(tmp_path):
    with own_folder(tmp_path):
        pass
    assert tmp_path.is_dir()
