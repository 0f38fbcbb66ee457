"""The folder that studies are written to: a CSV for each, the claims, and what they were made from."""

import csv
import io
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import yaml

from gapeval import __version__
from gapeval.files import make_folder, whole_files, write_whole
from gapeval.results.manifest import SCORER
from gapeval.studies.cases import Given
from gapeval.studies.claims import COLUMNS, Judged
from gapeval.studies.definition import NAMES, Study
from gapeval.studies.rows import Row, csv_text, with_best
from gapeval.sweep.provenance import content_digest, versions

CLAIMS, MANIFEST, STUDY = "claims.csv", "manifest.json", "study.yaml"


def about(user: Mapping[str, Any], given: Given | None, quick: bool) -> dict[str, Any]:
    """What decides all that is in the folder, but the studies themselves."""
    return {
        "gapeval": __version__,
        "scorer": SCORER,
        "versions": versions(),
        "quick": quick,
        "log": None if given is None else given.log.name,
        "inputs": [] if given is None else [content_digest(path) for path in (given.log, given.labels)],
        "configuration": dict(user),
    }


def write_study(folder: Path, name: str, study: Study, rows: Sequence[Row]) -> Path:
    """The CSV of a study, and its YAML as it was run. Returns the CSV's path."""
    make_folder(folder / name)
    document = study.model_dump(mode="json", exclude_defaults=True)
    text = yaml.safe_dump(document, sort_keys=False, allow_unicode=True, width=110)
    write_whole(folder / name / STUDY, text.encode())
    path = folder / f"{name}.csv"
    write_whole(path, csv_text(with_best(rows), study).encode())
    return path


def write_claims(folder: Path, made_from: Mapping[str, Any], name: str, judged: Sequence[Judged]) -> None:
    """claims.csv and manifest.json with a study; others that are there, of the same inputs, stay."""
    there, kept = _before(folder, made_from)
    rows = {other: [row for row in kept if row["study"] == other] for other in there}
    rows[name] = [asdict(one) for one in judged]
    ours = [name for name in NAMES if name in rows]
    rows = {name: rows[name] for name in (*ours, *sorted(rows.keys() - set(NAMES)))}
    text = io.StringIO()
    writer = csv.DictWriter(text, COLUMNS, lineterminator="\n")
    writer.writeheader()
    for of in rows.values():
        writer.writerows(of)
    with whole_files(folder, (CLAIMS, MANIFEST)) as files:
        files[CLAIMS].write(text.getvalue())
        json.dump({**made_from, "studies": list(rows)}, files[MANIFEST], indent=2, ensure_ascii=False)
        files[MANIFEST].write("\n")


def _before(folder: Path, made_from: Mapping[str, Any]) -> tuple[list[str], list[dict[str, str]]]:
    """The studies of an earlier command, and their claims, where they were made from the same."""
    try:
        manifest = json.loads((folder / MANIFEST).read_text(encoding="utf-8"))
        names = list(manifest.pop("studies"))
        if manifest != json.loads(json.dumps(made_from)):
            return [], []
        with (folder / CLAIMS).open(newline="", encoding="utf-8") as file:
            return names, list(csv.DictReader(file))
    except (OSError, ValueError, KeyError, AttributeError, TypeError):
        return [], []
