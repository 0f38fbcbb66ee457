"""Tables and pictures of docs/reproduction.md, from the CSV files of a folder of studies."""

import csv
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from documentation import DOCS, cell, with_part

PAGE = DOCS / "reproduction.md"
PICTURES = DOCS / "reproduction"

Row = dict[str, str]
Where = dict[str, str | tuple[str, ...]]


@dataclass(frozen=True)
class Table:
    """Rows of a study's CSV. where: columns that must be equal, or one of several; keys: columns as they are;
    figures: columns with their intervals."""

    study: str
    name: str
    keys: tuple[str, ...]
    figures: tuple[str, ...]
    where: Where = field(default_factory=dict)


FOUND = ("hit_rate", "fp_per_frame", "coverage", "f1", "pq")
ALL = {"scene": "all", "by": ""}
TABLES = (
    Table("delta_r", "delta_r", ("delta_r", "best"), FOUND, ALL),
    Table("delta_r", "bins", ("delta_r",), ("bin_ratio", "bin_filled"), {"by": "bins"}),
    Table("resolution", "resolution", ("k", "best"), (*FOUND, "near_edge_error"), ALL),
    Table(
        "resolution",
        "resolution_scenes",
        ("scene", "k"),
        ("hit_rate", "fp_per_frame", "f1"),
        {"scene": ("tunnel", "barrel", "street", "approach"), "k": ("6", "7", "8")},
    ),
    Table(
        "values",
        "missing_less",
        ("k", "n_o", "delta_r", "pl_th"),
        ("hit_rate", "fp_per_frame", "f1"),
        {**ALL, "radius": "3.0", "k": "7", "n_o": "2", "delta_r": "1.05"},
    ),
    Table(
        "radius",
        "bearing",
        ("group",),
        ("hit_rate",),
        {"scene": "all", "by": "bearing", "domain": "3.0", "r_max": "3.0"},
    ),
    Table(
        "morphology",
        "morphology",
        ("n_o", "delta_r", "best"),
        ("hit_rate", "fp_per_frame", "splits", "merges", "f1"),
        ALL,
    ),
    Table(
        "plane_threshold",
        "roughness",
        ("roughness", "pl_th", "best"),
        ("hit_rate", "fp_per_frame", "f1"),
        {**ALL, "slope": ""},
    ),
    Table(
        "plane_threshold",
        "slope",
        ("slope", "pl_th"),
        ("fp_per_frame", "over_area"),
        {**ALL, "roughness": "", "pl_th": "0.1"},
    ),
    Table(
        "occlusion",
        "occlusion",
        ("scene", "obstacles", "shading"),
        ("shadow_gaps", "fp_per_frame", "hit_rate"),
        {},
    ),
    Table(
        "pose_error",
        "noise",
        ("tilt_noise",),
        ("over_area", "fp_per_frame", "hit_rate", "f1"),
        {**ALL, "error": "noise"},
    ),
    *(
        Table(
            "pose_error",
            error,
            (error,),
            ("over_area", "fp_per_frame", "hit_rate", "f1"),
            {**ALL, "error": error},
        )
        for error in ("roll", "pitch", "height")
    ),
    Table(
        "radius",
        "radius",
        ("r_max", "i_width"),
        ("hit_rate", "fp_per_frame", "coverage", "f1"),
        {"scene": "street", "by": "", "domain": ""},
    ),
    Table(
        "radius",
        "position",
        ("group", "r_max"),
        ("hit_rate",),
        {"scene": "street", "by": "position", "i_width": "65", "domain": ""},
    ),
    Table(
        "radius",
        "range",
        ("group", "r_max"),
        ("hit_rate", "near_edge_error"),
        {"scene": "all", "by": "range", "i_width": "65", "domain": "", "r_max": "10.0"},
    ),
    Table(
        "radius",
        "density",
        ("density", "r_max"),
        ("fp_per_frame", "over_area"),
        {"scene": "plain", "by": "", "i_width": "65"},
    ),
    Table(
        "crossing",
        "crossing",
        ("scene", "uniform"),
        ("axis_angle", "npca_yaw_error", "pca_yaw_error", "npca_length_error", "pca_length_error"),
        {"by": "", "k": "6", "r_max": "3.0"},
    ),
    Table(
        "crossing",
        "shapes",
        ("scene", "group"),
        ("axis_angle", "npca_yaw_error", "pca_yaw_error"),
        {"by": "label", "k": "7", "r_max": "5.0", "uniform": "area"},
    ),
    Table("timing", "timing", ("points", "k"), ("median", "p95", "mean"), {}),
    Table("sensors", "sensors", ("sensor", "delta_r", "best"), ("hit_rate", "fp_per_frame", "f1"), ALL),
    Table(
        "sensors",
        "sensor_bins",
        ("sensor", "delta_r"),
        ("bin_ratio", "bin_filled", "ring_growth", "box_seen"),
        {"by": "bins"},
    ),
    Table(
        "deviations",
        "deviations",
        ("sensor", "deviation"),
        ("hit_rate", "fp_per_frame", "over_area", "f1", "npca_accuracy"),
        ALL,
    ),
)
BEST = ("hit_rate", "fp_per_frame", "coverage", "f1", "pq")
WIDTHS = {"0.25-0.30": 0.4, "0.55-0.70": 0.8, "1.1-1.35": 2.0}  # m, of the trenches of `approach`
PAPER = {"k": "6", "n_o": "1", "delta_r": "1.1", "pl_th": "0.1"}


def rows(path: Path) -> list[Row]:
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def fits(row: Row, where: Where) -> bool:
    return all(
        row.get(key, "") in (value if isinstance(value, tuple) else (value,)) for key, value in where.items()
    )


def figure(row: Row, name: str) -> str:
    """`0.71 [0.65, 0.77]`; a dash where it is undefined."""
    value, low, high = (row.get(f"{name}{end}", "") for end in ("", "_low", "_high"))
    if not value:
        return "-"
    return f"{float(value):.3g}" + (f" [{float(low):.3g}, {float(high):.3g}]" if low and high else "")


def table(head: Sequence[str], body: Sequence[Sequence[str]]) -> str:
    lines = [head, ["---"] * len(head), *body]
    return "\n".join("| " + " | ".join(map(cell, line)) + " |" for line in lines)


def made(folder: Path, asked: Table) -> str:
    chosen = [row for row in rows(folder / f"{asked.study}.csv") if fits(row, asked.where)]
    keys = [key for key in asked.keys if any(row.get(key) for row in chosen)]
    body = [
        [
            *("yes" if key == "best" and row[key] else row[key] for key in keys),
            *(figure(row, name) for name in asked.figures),
        ]
        for row in chosen
    ]
    return table([*keys, *asked.figures], body)


def claims(folder: Path) -> str:
    body = [
        [
            f"{row['words']} ({row['section']})",
            row["verdict"],
            row["conditions"],
            f"{row['study']}: {row['claim']}",
        ]
        for row in rows(folder / "claims.csv")
    ]
    return table(["the paper says (section)", "verdict", "under which conditions", "study: claim"], body)


def weighing(folder: Path) -> str:
    (measured,) = (
        row["measured"]
        for row in rows(folder / "claims.csv")
        if row["claim"] == "weighing_by_confidence_helps"
    )
    return f"claims.csv, weighing_by_confidence_helps: {measured}"


def values(folder: Path) -> str:
    """The paper's values beside the best of the joint search."""
    body = []
    for row in rows(folder / "values.csv"):
        if not fits(row, ALL) or not (row["best"] or fits(row, PAPER)):
            continue
        name = "best" if row["best"] else "paper"
        body.append([row["radius"], name, *(row[key] for key in PAPER), *(figure(row, one) for one in BEST)])
    return table(["radius", "values", *PAPER, *BEST], body)


def approaches(folder: Path) -> str:
    """From where trenches are seen that the robot drives towards, by radius, at i_width 65."""
    run = folder / "radius" / "street"
    radius = {
        row["configuration"]: row["r_max"] for row in rows(run / "summary.csv") if row["i_width"] == "65"
    }
    groups: dict[tuple[str, str], list[Row]] = {}
    for row in rows(run / "approaches.csv"):
        if row["log"].startswith("approach") and row["configuration"] in radius:
            width = next(name for name, most in WIDTHS.items() if float(row["width"]) <= most)
            groups.setdefault((radius[row["configuration"]], width), []).append(row)
    body = [
        [
            *key,
            str(len(group)),
            str(sum(not row["first_hit"] for row in group)),
            mean(group, "first_hit"),
            mean(group, "nearest_missed"),
            mean(group, "nearest"),
        ]
        for key, group in sorted(groups.items(), key=lambda item: (float(item[0][0]), item[0][1]))
    ]
    head = [
        "r_max",
        "width [m]",
        "trenches",
        "never hit",
        "first_hit [m]",
        "nearest_missed [m]",
        "nearest [m]",
    ]
    return table(head, body)


def mean(group: Sequence[Row], name: str) -> str:
    known = [float(row[name]) for row in group if row[name]]
    return f"{sum(known) / len(known):.2f}" if known else "-"


def main() -> None:
    with tempfile.TemporaryDirectory() as work:
        command = [sys.executable, "-m", "gapeval"]
        folder = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(work, "studies")
        if len(sys.argv) == 1:
            subprocess.run([*command, "study", "-o", folder], check=True)
        page = PAGE.read_text(encoding="utf-8")
        parts = {
            "claims": claims(folder),
            "values": values(folder),
            "approaches": approaches(folder),
            "weighing": weighing(folder),
        }
        for name, text in parts.items():
            page = with_part(page, name, text + "\n", script="reproduce")
        for asked in TABLES:
            page = with_part(page, asked.name, made(folder, asked) + "\n", script="reproduce")
        PAGE.write_text(page, encoding="utf-8")
        png = Path(work, "png")
        subprocess.run([*command, "report", folder, "-o", Path(work, "r.html"), "--png", png], check=True)
        PICTURES.mkdir(exist_ok=True)
        for path in PICTURES.glob("*.png"):
            shutil.copy(png / path.name, path)


if __name__ == "__main__":
    main()
