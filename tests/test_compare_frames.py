"""The frames and labels behind figures, against plain readers of the same files."""

import csv
import io
from collections.abc import Sequence
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from result_folders import Texts, cells, compared, copied, edited, table, the_row, write_table

from gapeval.compare.frames import read_frames
from gapeval.compare.labels import LabelFile, label_changes
from gapeval.compare.outcome import LabelChange
from gapeval.errors import GapevalError
from gapeval.results.tables import FRAME_COLUMNS, LABEL_COLUMNS
from gapeval.scoring.metrics import SUMS, WITHOUT_LABELS

RANDOM = settings(
    deadline=None,
    derandomize=True,
    max_examples=50,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
NAMES = st.text(st.characters(codec="utf-8", exclude_characters="\r\n\x00"), min_size=1, max_size=6)
AWKWARD = st.sampled_from(["a.mcap", "b, c.mcap", '"quoted".bag', "NA", "nan", "1", "-", "å\u2028\x85 ", "'"])
LOGS = st.lists(AWKWARD | NAMES, min_size=1, max_size=3, unique=True)
IDS = st.lists(
    st.sampled_from(["3c9b3390da40", "2fb9257526a2", "000000000000", "foreign", 'a "b", c', "1e5"]),
    min_size=1,
    max_size=4,
    unique=True,
)
STAMPS = st.lists(
    st.integers(-(2**62), 2**62) | st.integers(-3, 120), min_size=1, max_size=6, unique=True
).map(sorted)
SUM = st.floats(allow_nan=False, allow_infinity=False) | st.integers(0, 500).map(float)


def frame_rows(data: st.DataObject, logs: Sequence[str], ids: Sequence[str]) -> list[Texts]:
    """Rows of frames.csv in their order; some frames were not scored."""
    rows = []
    for log in logs:
        for stamp in data.draw(STAMPS):
            is_scored = data.draw(st.booleans())
            names = SUMS if is_scored else WITHOUT_LABELS
            for name in ids:
                values = dict.fromkeys(SUMS, "") | dict.fromkeys(names, "1")
                values |= {one: repr(data.draw(SUM)) for one in ("over_area_sum",) if one in names}
                values |= {one: str(data.draw(st.integers(0, 9))) for one in ("gaps", "hits") if one in names}
                head = {"log": log, "stamp": str(stamp), "configuration": name, "plane_fallback": ""}
                rows.append(head | values)
    return rows


@RANDOM
@given(data=st.data(), logs=LOGS, ids=IDS)
def test_frames_in_any_order_are_read_as_they_stand(
    tmp_path: Path, data: st.DataObject, logs: list[str], ids: list[str]
) -> None:
    rows = frame_rows(data, logs, ids)
    skipped, above = data.draw(st.sampled_from([(0, ""), (2, "# {\n# }\n")]))
    path = tmp_path / "frames.csv"
    whole = dict.fromkeys(SUMS, "7") | {"plane_fallback": "", "stamp": ""}  # as a baseline has them
    of_logs = [whole | {"log": log, "configuration": name} for log in (*logs, "all") for name in ids]
    of_logs = of_logs if skipped else []
    write_table(path, [*of_logs, *data.draw(st.permutations(rows))], FRAME_COLUMNS)
    text = path.read_text(encoding="utf-8")
    end = data.draw(st.sampled_from(["\n", "\r\n"]))
    path.write_bytes((above + text).replace("\n", end).encode())
    wanted = data.draw(st.lists(st.sampled_from(ids), unique=True, min_size=1))
    found = read_frames(path, skipped, wanted)
    assert sorted(found) == sorted(logs)
    for log, frames in found.items():
        stamps = sorted({int(row["stamp"]) for row in rows if row["log"] == log})
        assert frames.stamps.tolist() == stamps
        assert set(frames.place) == set(wanted)
        for row in rows:
            if row["log"] == log and row["configuration"] in wanted:
                at = stamps.index(int(row["stamp"])), frames.place[row["configuration"]]
                read = {name: values[at] for name, values in frames.sums.items()}
                assert read == {name: float(row[name] or 0) for name in SUMS}  # to the bit
        chosen = frames.of(wanted[::-1])
        assert list(chosen.place) == wanted[::-1]
        for place, name in enumerate(wanted[::-1]):
            assert (chosen.sums["gaps"][:, place] == frames.sums["gaps"][:, frames.place[name]]).all()


@RANDOM
@given(data=st.data(), is_twice=st.booleans())
def test_rows_that_are_missing_or_there_twice_are_refused(
    tmp_path: Path, data: st.DataObject, is_twice: bool
) -> None:
    ids = ["3c9b3390da40", "2fb9257526a2"]
    rows = frame_rows(data, ["a.mcap"], ids)
    at = data.draw(st.integers(0, len(rows) - 1))
    rows = [*rows, rows[at]] if is_twice else rows[:at] + rows[at + 1 :]
    path = tmp_path / "frames.csv"
    write_table(path, rows, FRAME_COLUMNS)
    if not is_twice and len(rows) == 1:
        frames = read_frames(path, 0, ids)["a.mcap"]
        with pytest.raises(GapevalError, match="frames of configuration"):
            frames.of(ids)
    else:
        with pytest.raises(GapevalError, match=r"frames\.csv: rows are missing or there twice"):
            read_frames(path, 0, ids)


@pytest.mark.parametrize(
    ("column", "text"),
    [
        *(("stamp", text) for text in ("soon", "1.5", "9" * 30, "nan", "inf", "-")),
        *(("gaps", text) for text in ("many", "1,2", "--", "0x1")),
    ],
)
def test_frames_that_are_none_are_one_error(results: Path, tmp_path: Path, column: str, text: str) -> None:
    new = copied(results, tmp_path / "new")
    rows = table(new / "frames.csv")
    rows[5][column] = text
    write_table(new / "frames.csv", rows)
    with pytest.raises(GapevalError, match=r"^[^\n]*frames\.csv: [^\n]*$"):
        read_frames(new / "frames.csv", 0, [row["configuration"] for row in rows[:4]])


@pytest.mark.parametrize("text", ["inf", "-inf", "nan"])
def test_sums_that_are_no_numbers_explain_nothing(results: Path, tmp_path: Path, text: str) -> None:
    new = edited(copied(results, tmp_path / "new"), cells({}, coverage=0.5))
    edited(new, cells({"log": "a.mcap"}, covered_area=text), "frames.csv")
    for row in compared(results, new).rows:
        for change in row.changes:
            assert change.noise is not None
            assert change.noise.beyond is None


def test_frames_without_a_column_or_a_table(tmp_path: Path) -> None:
    path = tmp_path / "frames.csv"
    for text in ("", "log,stamp\na,1\n", "\0", "log,stamp,configuration,gaps\na,1,b,2\n", "x" * 300_000):
        path.write_text(text)
        with pytest.raises(GapevalError, match=r"^[^\n]*frames\.csv: [^\n]*$"):
            read_frames(path, 0, ["b"])
    with pytest.raises(GapevalError, match="cannot be read"):
        read_frames(tmp_path / "none.csv", 0, ["b"])


# Labels


def label_row(log: str, stamp: int, configuration: str, label: str, hit: str) -> Texts:
    rest = dict.fromkeys(LABEL_COLUMNS, "")
    head = {"log": log, "stamp": str(stamp), "configuration": configuration}
    return rest | head | {"label": label, "hit": hit, "state": "visible"}


@RANDOM
@given(data=st.data(), logs=LOGS, ids=IDS)
def test_labels_are_found_by_halving_as_by_reading_all(
    tmp_path: Path, data: st.DataObject, logs: list[str], ids: list[str]
) -> None:
    """Stamps of any sign and number of digits; frames without labels."""
    labels = data.draw(st.lists(AWKWARD | NAMES, min_size=1, max_size=3, unique=True))
    rows, places = [], []
    for log in logs:
        for stamp in data.draw(STAMPS):
            for name in ids:
                places.append((log, stamp, name))
                drawn = data.draw(st.lists(st.sampled_from(labels), unique=True))
                hits = [data.draw(st.sampled_from(["true", "false", ""])) for _ in drawn]
                rows += [
                    label_row(log, stamp, name, label, hit) for label, hit in zip(drawn, hits, strict=True)
                ]
    path = tmp_path / "labels.csv"
    write_table(path, rows, LABEL_COLUMNS)
    file = LabelFile(path, logs, ids)
    for log, stamp, name in places:
        linear = {
            row["label"]: row["hit"] == "true"
            for row in csv.DictReader(io.StringIO(path.read_text(encoding="utf-8"), newline=""))
            if (row["log"], row["stamp"], row["configuration"]) == (log, str(stamp), name) and row["hit"]
        }
        assert file.states(log, stamp, name) == linear
        assert file.states(log, stamp + 2**63, name) == {}


@pytest.mark.parametrize(
    "line",
    ["a.mcap", "a.mcap,1", "a.mcap,one,2fb9257526a2", "none,1,2fb9257526a2", 'a.mcap,1,2fb9257526a2,"', ""],
)
def test_labels_that_are_none_are_one_error(tmp_path: Path, line: str) -> None:
    path = tmp_path / "labels.csv"
    if line.count(",") == 2:
        line += "," * (len(LABEL_COLUMNS) - 3)
    path.write_text(",".join(LABEL_COLUMNS) + f"\n{line}\n")
    with pytest.raises(GapevalError, match=r"^[^\n]*labels\.csv: not as gapeval writes it[^\n]*$"):
        LabelFile(path, ["a.mcap"], ["2fb9257526a2"]).states("a.mcap", 1, "2fb9257526a2")


@pytest.mark.parametrize("text", ["", "log,stamp\n", "\0\0"])
def test_a_file_of_labels_that_is_none(tmp_path: Path, text: str) -> None:
    path = tmp_path / "labels.csv"
    path.write_text(text)
    with pytest.raises(GapevalError, match=r"^[^\n]*labels\.csv: [^\n]*$"):
        LabelFile(path, ["a.mcap"], ["2fb9257526a2"]).states("a.mcap", 1, "2fb9257526a2")


def test_label_changes_are_grouped_by_what_became_of_them() -> None:
    before = [{"kerb": True, "trench": True}, {"trench": True}, {}, {"trench": False}, {"pit": True}]
    after = [{"kerb": True, "trench": False}, {}, {"trench": True}, {"trench": True}, {"pit": False}]
    frames = [(4, 400), (5, 500), (7, 700), (8, 800), (9, 900)]
    assert label_changes(frames, before, after) == (
        LabelChange("pit", "hit", "missed", (9,), (900,)),
        LabelChange("trench", "hit", "missed", (4,), (400,)),
        LabelChange("trench", "hit", "not asked for", (5,), (500,)),
        LabelChange("trench", "missed", "hit", (8,), (800,)),
        LabelChange("trench", "not asked for", "hit", (7,), (700,)),
    )


@RANDOM
@given(st.lists(st.tuples(*[st.dictionaries(st.sampled_from("abc"), st.booleans())] * 2), max_size=8))
def test_every_frame_in_which_a_label_changed_is_named_once(
    states: list[tuple[dict[str, bool], dict[str, bool]]],
) -> None:
    frames = [(index, 100 * index) for index in range(len(states))]
    found = label_changes(frames, [one for one, _ in states], [other for _, other in states])
    named = [(change.label, index) for change in found for index in change.frames]
    assert sorted(named) == sorted(
        (label, index)
        for index, (one, other) in enumerate(states)
        for label in {*one, *other}
        if one.get(label) != other.get(label)
    )
    assert all(list(change.frames) == sorted(set(change.frames)) for change in found)
    assert all(change.stamps == tuple(100 * index for index in change.frames) for change in found)
    missed = [change.now == "missed" for change in found]
    assert missed == sorted(missed, reverse=True)


# Which frames


@RANDOM
@given(data=st.data())
def test_frames_are_named_in_which_any_sum_changed(
    results: Path, tmp_path: Path, data: st.DataObject
) -> None:
    base = copied(results, tmp_path / "base") if not (tmp_path / "base").exists() else tmp_path / "base"
    new = copied(results, tmp_path / "new") if not (tmp_path / "new").exists() else tmp_path / "new"
    here = {"log": "a.mcap", "configuration": "2fb9257526a2"}
    (new / "summary.csv").write_bytes((results / "summary.csv").read_bytes())
    edited(new, cells(here, coverage=0.5))
    rows = table(results / "frames.csv")
    places = [at for at, row in enumerate(rows) if row.items() >= here.items()]
    moved = data.draw(
        st.dictionaries(st.integers(0, len(places) - 1), st.sampled_from(list(SUMS)), max_size=5)
    )
    for frame, name in moved.items():
        step = data.draw(st.sampled_from([1.0, 1e-3, 3e-9 * max(1.0, float(rows[places[frame]][name]))]))
        rows[places[frame]][name] = repr(float(rows[places[frame]][name]) + step)
    write_table(new / "frames.csv", data.draw(st.permutations(rows)) if len(moved) == 1 else rows)
    row = the_row(compared(base, new), **here)
    assert row.frames == tuple(sorted(moved))
    assert row.labels == ()
