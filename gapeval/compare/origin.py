"""What a manifest says of results: where they come from, and how they were scored."""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from gapeval.compare.outcome import Origin
from gapeval.errors import GapevalError

Manifest = Mapping[str, Any]


def checked(path: Path, manifest: Manifest) -> Manifest:
    """The same, as far as it is looked at. path: where it was read. Raises GapevalError."""
    for name in ("logs", "failed"):
        entries = manifest.get(name) or []
        if not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries):
            raise _damaged(path, name)
        for entry in entries:
            count = entry.get("frames") or 0
            if not isinstance(entry.get("log"), str):
                raise _damaged(path, f"log among its {name}")
            if not isinstance(count, int) or count < 0:
                raise _damaged(path, f"frames among its {name}")
    block = (scoring(manifest) or {}).get("block", 1.0)
    if not isinstance(block, int | float) or not 0 < block < math.inf:
        raise _damaged(path, "scoring.block")
    return manifest


def _damaged(path: Path, what: str) -> GapevalError:
    return GapevalError(f"{path}: {what}: not as gapeval writes it; run what made it again")


def origin(path: Path, manifest: Manifest, history: tuple[Mapping[str, Any], ...] = ()) -> Origin:
    """path: as it was given."""
    logs = manifest.get("logs") or ()
    gapeval, revision, source, scorer = (
        str(manifest.get(name) or "") for name in ("gapeval", "revision", "source", "scorer")
    )
    return Origin(
        str(path),
        gapeval,
        revision,
        source,
        scorer,
        logs={entry["log"]: str(entry.get("sha256") or "") for entry in logs},
        labels={entry["log"]: str(entry.get("labels") or "") for entry in logs},
        history=history,
    )


def scoring(manifest: Manifest) -> Mapping[str, Any] | None:
    """None where it is not said."""
    found = manifest.get("scoring")
    return found if isinstance(found, dict) else None


def failed(manifest: Manifest) -> dict[str, str]:
    """Of each log of which frames are missing: how many, and why the first are."""
    by_log: dict[str, list[Manifest]] = {}
    for entry in manifest.get("failed") or ():
        by_log.setdefault(entry["log"], []).append(entry)
    found = {}
    for log, entries in by_log.items():
        count = sum(int(entry.get("frames") or 0) for entry in entries)
        first = ", the first" if len(entries) > 1 else ""
        found[log] = f"{count} frame{'s' * (count != 1)} failed{first}: {entries[0].get('reason')}"
    return found


def frames(manifest: Manifest) -> dict[str, int]:
    """How many each log has."""
    return {entry["log"]: int(entry.get("frames") or 0) for entry in manifest.get("logs") or ()}
