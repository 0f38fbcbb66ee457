"""A small folder of studies, written by hand."""

import csv
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

CLAIMS = ("study", "claim", "section", "words", "measured", "verdict", "conditions", "rule", "source")

RESOLUTION = {
    "title": "Resolution",
    "paper": "Section 4.2.1, Fig. 8",
    "question": "How does the size of the polar image change what is found?",
    "says": "Below k = 5 small gaps are lost; above k = 7 gaps split.",
    "curves": [
        {
            "title": "By sensor",
            "x": "k",
            "y": ["hit_rate", "fp_per_frame"],
            "lines": "sensor",
            "where": {"by": "all", "scene": ["tunnel", "street"]},
        },
        {"x": "roughness", "y": ["f1"], "lines": None, "where": {"by": "roughness"}, "log_x": True},
        {"title": "By scene", "x": "scene", "y": ["hit_rate"], "lines": "sensor", "where": {"by": "scene"}},
        {"title": "Of nothing", "x": "k", "y": ["f1"], "where": {"by": "never"}},
    ],
}
MORPHOLOGY: dict[str, Any] = {
    "title": "Erosion & dilation <n_o>",
    "paper": "Section 4.2.3",
    "question": "",
    "says": "One erosion is enough.",
    "curves": [],
}

JUDGED = (
    ("resolution", "small-gaps", "4.2.1", "Small gaps are lost below k = 5",
     "hit_rate 0.31 (0.2 to 0.42) at k 4, 0.83 at k 6", "holds", "tunnel, lms151", "low.high < 0.5",
     "resolution.csv, rows with by = all, sensor = lms151"),
    ("resolution", "splits", "4.2.1", "Gaps split above k = 7",
     "splits 1.02 at k 8", "holds partly", "", "splits.low > 1", "resolution.csv, all rows"),
    ("morphology", "one", "4.2.3", "n_o = 1 is enough <always>",
     "f1 falls by 0.1", "does not hold", "street", "f1.low > 0", "morphology.csv, all rows"),
    ("morphology", "cross", "", "A cross does as well", "", "not measured", "", "", ""),
)  # fmt: skip


def write_studies(folder: Path, quick: bool = False) -> Path:
    """The folder: two studies, of which the second has no curve."""
    folder.mkdir(parents=True)
    about = {"gapeval": "0.1.0", "scorer": 2, "versions": {"python": "3.11.0"}, "quick": quick, "log": None}
    (folder / "manifest.json").write_text(json.dumps(about | {"studies": ["resolution", "morphology"]}))
    _table(folder / "claims.csv", CLAIMS, JUDGED)
    columns = ("scene", "sensor", "roughness", "by", "group", "k")
    metrics = ("hit_rate", "hit_rate_low", "hit_rate_high", "fp_per_frame", "f1", "asked")
    rows: list[tuple[Any, ...]] = []
    for s, sensor in enumerate(("lms151", "vlp16", "os1-64")):
        for k in (4, 5, 6, 7, 8):
            hit = 0.3 + 0.14 * (k - 4) - 0.08 * s
            rows.append(
                ("tunnel", sensor, 0.01, "all", "", k, hit, hit - 0.1, hit + 0.07, 0.2 * (k - 3) + s, 0.5, 24)
            )
        for n, scene in enumerate(("street", "hall", "slope")):
            hit = 0.9 - 0.1 * n - 0.05 * s
            rows.append((scene, sensor, 0.01, "scene", scene, 6, hit, hit - 0.1, hit + 0.05, 0.5, 0.6, 12))
    rows += [
        ("tunnel", "lms151", rough, "roughness", "", 6, 0.8, "", "", 0.1, 0.9 - 10 * rough, 24)
        for rough in (0.001, 0.01, 0.05)
    ]
    rows += [("hall", "lms151", 0.01, "all", "", 12, 1.0, "", "", 9.0, 1.0, 24)]  # of no curve: another scene
    _table(folder / "resolution.csv", (*columns, *metrics), rows)
    _table(folder / "morphology.csv", (*columns, *metrics), [])
    for name, study in {"resolution": RESOLUTION, "morphology": MORPHOLOGY}.items():
        (folder / name).mkdir()
        (folder / name / "study.yaml").write_text(yaml.safe_dump(study, sort_keys=False))
    run = folder / "resolution" / "runs" / "tunnel-lms151"
    run.mkdir(parents=True)
    (run / "summary.csv").write_text("log\n")
    return folder


def _table(path: Path, head: Sequence[str], rows: Sequence[Sequence[Any]]) -> None:
    with path.open("w", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerows([head, *rows])


def rows_of(path: Path) -> list[Mapping[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))
