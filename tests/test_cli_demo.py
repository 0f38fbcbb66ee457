"""The demo: what a new user sees first."""

import csv
import json

from command import gapeval


def test_the_demo_sweeps_the_tunnel_around_the_papers_values(tmp_path) -> None:
    folder = tmp_path / "demo"
    done = gapeval("demo", "-o", folder, "--jobs", 2)
    assert done.status == 0
    assert done.out.startswith("Best of 144 configurations, chosen on these data:")
    with (folder / "results" / "summary.csv").open() as file:
        rows = [row for row in csv.DictReader(file) if row["log"] == "all"]
    assert len(rows) == 144
    papers = [r for r in rows if (r["k"], r["n_o"], r["delta_r"], r["pl_th"]) == ("6", "1", "1.1", "0.1")]
    assert len(papers) == 1
    # The same configuration, the same gaps: what is detected in the demo is what is scored in it.
    detected = json.loads((folder / "detections.geojson").read_text())
    assert detected["configuration"]["id"] == papers[0]["configuration"]
    assert len(detected["features"]) == int(papers[0]["gaps"])
    assert 0.7 < float(papers[0]["hit_rate"]) <= 1  # docs/tunnel.md has the distribution
    printed = [line for line in done.out.splitlines() if line.startswith(papers[0]["configuration"])]
    assert len(printed) == 1  # whatever its rank
    for line in done.out.splitlines()[-4:]:
        assert (folder / line.split("/")[-1]).is_file(), line
    again = gapeval("demo", "-o", folder, "--jobs", 2)
    assert again.status == 0
    assert again.out.splitlines()[:8] == done.out.splitlines()[:8]
