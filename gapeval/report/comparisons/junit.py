"""A comparison as JUnit XML, for what shows test results: Jenkins, GitLab and others."""

import math
from xml.etree import ElementTree

from gapeval.compare.outcome import Comparison, Row, Time
from gapeval.report.comparisons.failures import FAILURES, WORDS, account, worst
from gapeval.report.comparisons.origins import LOGS, ORIGINS, log_cells, origin_cells
from gapeval.report.comparisons.verdict import verdict
from gapeval.report.comparisons.words import frames_sentence, parameters, plain

DECLARATION = '<?xml version="1.0" encoding="UTF-8"?>'
SUITE = "gapeval compare"
# Demanded by one of the two schemas in use. Same input, same bytes: neither a date nor a host, and no
# seconds, since what is compared was measured elsewhere.
WHEN, WHERE, SECONDS = "1970-01-01T00:00:00", "localhost", "0"


def junit(comparison: Comparison) -> str:
    """A case for each row, and for each time that has a limit; classname: the log.

    <error>: not comparable; <failure>: worse or lost. All else passes, also what is in NEW alone.
    """
    limited = [time for time in comparison.times if math.isfinite(time.limit) or time.mark in FAILURES]
    rows = [(row, f"{row.configuration} {parameters(row, comparison.varied)}") for row in comparison.rows]
    cases = [*(_case(row, name) for row, name in rows), *(_case(time, time.metric) for time in limited)]
    suite = ElementTree.Element(
        "testsuite",
        {
            "name": SUITE,
            "package": SUITE,
            "id": "0",
            "tests": str(len(cases)),
            "failures": str(sum(case.find("failure") is not None for case in cases)),
            "errors": str(sum(case.find("error") is not None for case in cases)),
            "time": SECONDS,
            "timestamp": WHEN,
            "hostname": WHERE,
        },
    )
    suite.append(_properties(comparison))
    suite.extend(cases)
    ElementTree.SubElement(suite, "system-out").text = "\n".join(
        [*map(plain, comparison.notices), verdict(comparison)]
    )
    ElementTree.SubElement(suite, "system-err")
    suites = ElementTree.Element("testsuites")
    suites.append(suite)
    ElementTree.indent(suites, "")
    return f"{DECLARATION}\n{ElementTree.tostring(suites, 'unicode')}\n"


def _properties(comparison: Comparison) -> ElementTree.Element:
    found = ElementTree.Element("properties")
    for name, *cells in origin_cells(comparison):
        for field, cell in zip(ORIGINS[1:], cells, strict=True):
            ElementTree.SubElement(found, "property", {"name": f"{name}.{field}", "value": cell})
    for log, *digests in log_cells(comparison):
        for field, digest in zip(LOGS[1:], digests, strict=True):
            ElementTree.SubElement(found, "property", {"name": f"{log}.{field}", "value": digest})
    return found


def _case(one: Row | Time, name: str) -> ElementTree.Element:
    case = ElementTree.Element(
        "testcase", {"classname": plain(one.log), "name": plain(name).strip(), "time": SECONDS}
    )
    mark = worst(one)
    if mark in FAILURES:
        message, *others = account(one)
        frames = frames_sentence(one) if isinstance(one, Row) else ""
        more = f" (and {len(others)} more lines)" if others else ""
        kind = "error" if mark == "x" else "failure"
        found = ElementTree.SubElement(case, kind, {"type": WORDS[mark], "message": message + more})
        found.text = "\n".join(line for line in (message, *others, frames) if line)
    return case
