"""How much is looked at behind the rows of a large grid: the worst."""

from pathlib import Path

import pytest
from result_folders import cells, compared, copied, edited, swept, table

FRAMES, CONFIGURATIONS, LABELLED, LEAST = 3, 12, 10, 10


@pytest.fixture(scope="module")
def large(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Results of more configurations than labels are told of."""
    grid = ("-p", "pl_th=" + ",".join(f"0.0{at + 50}" for at in range(CONFIGURATIONS)), "-p", "delta_r=1.05")
    return swept(tmp_path_factory.mktemp("large"), (FRAMES,), grid)


@pytest.fixture
def worse(large: Path, tmp_path: Path) -> Path:
    """All of them worse, each in its second frame, where the trench is missed."""
    new = copied(large, tmp_path / "new")
    second = table(new / "frames.csv")[CONFIGURATIONS]["stamp"]
    edited(new, cells({"stamp": second}, hits="0", covered_area="0.0"), "frames.csv")
    edited(new, cells({"stamp": second}, hit="false"), "labels.csv")
    for at, row in enumerate(table(new / "summary.csv")[:CONFIGURATIONS]):
        edited(new, cells({"configuration": row["configuration"]}, coverage=0.01 * at))
    return new


def test_labels_of_the_worst_rows_are_told(large: Path, worse: Path) -> None:
    rows = compared(large, worse).rows
    assert [row.frames for row in rows] == [(1,)] * CONFIGURATIONS
    assert [row.labels is None for row in rows] == [False] * LABELLED + [True] * (CONFIGURATIONS - LABELLED)
    assert {row.unknown for row in rows} == {""}
    assert all({change.now for change in row.labels or ()} <= {"missed"} for row in rows)
    assert any(row.labels for row in rows)


@pytest.mark.parametrize("most", [0, LEAST, LEAST + 1, CONFIGURATIONS])
def test_frames_of_the_worst_configurations_are_looked_at(
    large: Path, worse: Path, monkeypatch: pytest.MonkeyPatch, most: int
) -> None:
    """As many as can be read in a second or so, and never less than those whose labels are told."""
    monkeypatch.setattr("gapeval.compare.details.LOOKED_AT", most * FRAMES)
    rows = compared(large, worse).rows
    seen = max(LEAST, most)
    assert [row.frames == (1,) for row in rows] == [True] * seen + [False] * (CONFIGURATIONS - seen)
    said = f"only the frames of the worst {seen} configurations were looked at"
    assert [row.unknown for row in rows[seen:]] == [said] * (CONFIGURATIONS - seen)
    assert {row.mark for row in rows} == {"+"}
    for row in rows[seen:]:
        assert {change.noise for change in row.changes} == {None}
