"""The description of a log as text for people."""

from collections.abc import Sequence

from gapeval.logs.read.description import (
    Choice,
    CloudSummary,
    Description,
    EdgeSummary,
    PlanarSummary,
    TopicSummary,
)


def render(description: Description) -> str:
    """The description as text for people, without a line break at its end."""
    d = description
    lines = [f"{d.path}: {d.container}{_span(d.start, d.end)}", "", "topics"]
    lines += _table([(t.name, t.type, f"{t.count}", _foreign(t)) for t in d.topics])
    for cloud in d.clouds:
        lines += ["", *_cloud_lines(cloud)]
    lines += [line for scan in d.scans for line in ("", *_planar_lines(scan))]
    if d.transforms:
        lines += ["", "transforms"]
        lines += _table([(f"{e.parent} <- {e.child}", e.kind, _edge_rate(e), e.source) for e in d.transforms])
    lines += ["", *(_choice_lines(d.choice) if d.choice is not None else [f"cannot be swept: {d.problem}"])]
    lines += [f"lost: {loss}" for loss in d.losses]
    lines += [f"note: {notice}" for notice in d.notices]
    return "\n".join(lines)


def _choice_lines(choice: Choice) -> list[str]:
    fixed = choice.fixed_frame or "none"
    rows = [
        ("cloud topic", choice.cloud_topic),
        ("frames", f"robot {choice.robot_frame}, fixed {fixed}, sensor {choice.sensor_frame}"),
        ("poses", choice.pose_source),
        ("clouds", f"{choice.matched} of {choice.total} have all transforms"),
        ("lowest ray", f"{choice.lowest_elevation:.2f} deg"),
    ]
    for reason, count in choice.refused.items():
        shown = ", ".join(str(stamp) for stamp in choice.examples.get(reason, ()))
        rows.append(("refused", f"{count} x {reason} (e.g. {shown})"))
    return ["picked", *_table(rows)]


def _cloud_lines(cloud: CloudSummary) -> list[str]:
    rate = "" if cloud.rate is None else f", {cloud.rate:.2f} Hz"
    order = "big" if cloud.is_bigendian else "little"
    lines = [
        f"clouds on {cloud.topic}: frame {cloud.frame_id or '(none)'}, {cloud.width} x {cloud.height}{rate}",
        f"  {cloud.point_step} bytes per point, {order}-endian; first cloud: {cloud.finite} points, "
        f"{cloud.not_finite} NaN or infinite, {cloud.zero} at (0, 0, 0)",
    ]
    if cloud.problem:
        lines.append(f"  cannot be read: {cloud.problem}")
    if cloud.time is not None:
        lines.append(
            f"  {cloud.time.name} says when each point was measured: {cloud.time.unit} since "
            f"{'1970' if cloud.time.origin == 'absolute' else 'the stamp'}, over {cloud.time.span:.3f} s"
        )
    elif cloud.no_time:
        lines.append(f"  no time for each point: {cloud.no_time}")
    fields = [
        (f.name, f.type + (f"[{f.count}]" if f.count > 1 else ""), f"at {f.offset}") for f in cloud.fields
    ]
    return lines + _table(fields)


def _planar_lines(scan: PlanarSummary) -> list[str]:
    first, last = scan.angles
    return [
        f"planar scans on {scan.topic}: frame {scan.frame_id or '(none)'}, {scan.beams} beams",
        f"  from {first:.2f} to {last:.2f} deg, {scan.time_increment * 1e6:.4g} us from beam to beam; "
        f"first scan: {scan.echoes} echoes",
    ]


def _edge_rate(edge: EdgeSummary) -> str:
    return f"{edge.count} x" + ("" if edge.rate is None else f", {edge.rate:.1f} Hz")


def _foreign(topic: TopicSummary) -> str:
    return "" if topic.serialization in ("ros1", "cdr") else topic.serialization


def _span(start: int | None, end: int | None) -> str:
    return "" if start is None or end is None else f", {(end - start) / 1e9:.1f} s from {start / 1e9:.3f}"


def _table(rows: Sequence[tuple[str, ...]]) -> list[str]:
    if not rows:
        return []
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    return [
        "  " + "  ".join(text.ljust(w) for text, w in zip(row, widths, strict=True)).rstrip() for row in rows
    ]
