# SPDX-License-Identifier: Apache-2.0
"""The results of `benchmarks.gpu.run` as Markdown, complete or not."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Any


def short(text: str, most: int = 200) -> str:
    """Text as one line that fits a table's cell."""
    line = " ".join(text.split()).replace("|", "/")
    return line if len(line) <= most else line[: most - 1] + "…"


def number(value: float) -> str:
    """Three digits, and no exponent."""
    return f"{value:.0f}" if value >= 100 else f"{value:.3g}" if value >= 0.001 or value == 0 else "< 0.001"


def table(results: dict[str, Any]) -> str:
    """All sections that have something to say."""
    facts = results["facts"]
    sizes = ",".join(map(str, results["sizes"]))
    command = f"`python -m benchmarks.gpu.run --minutes {results['minutes']:g} --sizes {sizes}`"
    took = f"took {results['took'] / 60:.1f} minutes" if "took" in results else "is not finished"
    lines = [f"### {facts.get('device', 'No device')}, {results['date']}", "", f"{command}; it {took}.", ""]
    sections = (_facts, _goals, _filters, _kernels, _programs, _bits, _tests, _left_out)
    return "\n".join([*lines, *(line for section in sections for line in section(results))])


def _rows(head: str, rows: Iterable[Iterable[str]]) -> list[str]:
    made = [f"| {' | '.join(row)} |" for row in rows]
    return [head, "|" + "---|" * (head.count("|") - 1), *made, ""] if made else []


def _facts(results: dict[str, Any]) -> list[str]:
    facts, copies = results["facts"], results["copies"]
    if "error" in facts:
        return [f"No device could be opened: {short(facts['error'])}", ""]
    left_out = ("device", "devices", "number", "cpu", "kind")
    rows = [(name, short(str(value), 300)) for name, value in facts.items() if name not in left_out]
    if "error" in copies:
        rows.append(("bandwidth", short(copies["error"])))
    elif copies:
        rates = f"copied {copies['copy'] / 1e9:.0f}, by a kernel {copies['kernel'] / 1e9:.0f}"
        host = f"from the host {copies['upload'] / 1e9:.1f}, to it {copies['download'] / 1e9:.1f}"
        rows.append(("bandwidth, GB/s", f"{rates} (read and written); {host}"))
        rows.append(("a launch", f"{copies['launch'] * 1e6:.1f} µs"))
    if results["other"]:
        rows.append(("compared with", short(results["other"])))
    return _rows("| | |", rows)


def _timed(results: dict[str, Any], workload: str, where: str = "device") -> list[dict[str, Any]]:
    rows = results["filters"]
    return [r for r in rows if (r["workload"], r["where"]) == (workload, where) and "seconds" in r]


def _goals(results: dict[str, Any]) -> list[str]:
    if not results["filters"]:
        return []
    rows = []
    for workload in ("texsynth", "SLIC, ten iterations"):
        best = max(_timed(results, workload), key=_rate, default=None)
        figure = "not measured"
        if best is not None:
            figure = f"{number(_rate(best))} at {best['side']} px; kernels alone {number(_kernel_rate(best))}"
        rows.append((f"{workload}: 300 Mpix/s", figure, _verdict(best and _rate(best) >= 300)))
    tile = next((r for r in _timed(results, "texstationarize") if r["side"] == 4096), None)
    figure = f"{tile['seconds']:.1f} s; kernels alone {_in_kernels(tile):.1f} s" if tile else "not measured"
    rows.append(("texstationarize, 4096 x 4096: 5 s", figure, _verdict(tile and tile["seconds"] <= 5)))
    return _rows("| goal on a GPU | figure | |", rows)


def _verdict(met: bool | None) -> str:
    return "" if met is None else "met" if met else "missed"


def _rate(row: dict[str, Any]) -> float:
    return row["side"] ** 2 / row["seconds"] / 1e6


def _in_kernels(row: dict[str, Any]) -> float:
    return sum(k["seconds"] for name, k in row["kernels"].items() if "_" in name)


def _kernel_rate(row: dict[str, Any]) -> float:
    return row["side"] ** 2 / max(_in_kernels(row), 1e-9) / 1e6


def _filters(results: dict[str, Any]) -> list[str]:
    rows = []
    for row in results["filters"]:
        if row["where"] != "device":
            continue
        name = [row["workload"], str(row["side"])]
        if "error" in row:
            rows.append([*name, "failed", short(row["error"]), "", "", "", ""])
            continue
        copies = sum(k["seconds"] for n, k in row["kernels"].items() if "_" not in n)
        other = next((r for r in _timed(results, row["workload"], "other") if r["side"] == row["side"]), None)
        beside = [number(other["seconds"]), f"{other['seconds'] / row['seconds']:.1f}"] if other else ["", ""]
        figures = [
            number(row["seconds"]),
            number(_rate(row)),
            number(_in_kernels(row)),
            number(copies),
        ]
        rows.append([*name, *figures, *beside])
    for row in results["filters"]:
        if row["where"] == "other" and "error" in row:
            rows.append([f"{row['workload']}, CPU", str(row["side"]), "failed", short(row["error"]), "", "", "", ""])
    head = "| filter | px | s | Mpix/s | s in kernels | s in copies | CPU runtime, s | times faster |"
    note = (
        "Whole calls from Python, with Lab but in SLIC's; the best of three where they are quick. CPU: of that machine."
    )
    return [*_rows(head, rows), note, ""] if rows else []


def _kernels(results: dict[str, Any]) -> list[str]:
    """Every kernel at the largest size that ran it, in the first workload there; those that take longest first."""
    from benchmarks.gpu.bounds import WORK

    bandwidth = max((results["copies"].get(n, 0.0) for n in ("copy", "kernel")), default=0.0)
    found: dict[str, tuple[str, dict[str, Any]]] = {}
    for row in sorted(results["filters"], key=lambda row: -row["side"]):
        if row["where"] == "device":
            for name, kernel in row.get("kernels", {}).items():
                if "_" in name:
                    found.setdefault(name, (f"{row['workload']} | {row['side']}", kernel))
    rows = []
    for name, (workload, kernel) in sorted(found.items(), key=lambda item: -item[1][1]["seconds"]):
        seconds, calls = max(kernel["seconds"], 1e-9), kernel["calls"]
        bound, share, work = "not declared", "", ""
        if kernel["bytes"] is not None:
            bound = number(kernel["bytes"] / 1e6)
            share = f"{number(100 * kernel['bytes'] / bandwidth / seconds)} %" if bandwidth else ""
        if kernel["work"] is not None:
            work = f"{number(kernel['work'] / seconds / 1e9)} G {WORK[name][0]}/s"
        figures = [str(calls), number(1e3 * seconds), number(1e6 * seconds / calls), bound, share, work]
        rows.append([f"`{name}`", workload, *figures])
    head = "| kernel | in | px | calls | ms | µs a call | MB at least | of the bandwidth | looks at, at most |"
    note = (
        "MB: what must be read and written once (benchmarks/gpu/bounds.py), compared with the"
        " bandwidth of a copy in this run; above 100 %, a cache holds it."
    )
    return [*_rows(head, rows), note, ""] if rows else []


def said(log: str) -> str:
    """A compiler's first warning and their number, or the registers of each kernel by NVIDIA's compiler."""
    log = re.sub(r"/\S*/", "", log)  # folders of temporary files
    registers, kernel = {}, ""
    for line in log.splitlines():
        if found := re.search(r"Compiling entry function '(\w+)'", line):
            kernel = found[1]
        if found := re.search(r"(\d+) bytes stack frame, (\d+) bytes spill stores", line):
            registers[kernel] = f" ({found[1]} bytes of stack, {found[2]} spilled)" if found[1] != "0" else ""
        if found := re.search(r"Used (\d+) registers", line):
            registers[kernel] = f"{kernel.partition('_')[2]} {found[1]}{registers.get(kernel, '')}"
    warnings = [line for line in log.splitlines() if "warning" in line.lower() and "generated" not in line]
    parts = [f"{len(warnings)} warnings, as {short(warnings[0])}"] if warnings else []
    parts += [f"registers: {', '.join(registers.values())}"] if registers else []
    return "; ".join(parts) or short(log) or "nothing"


def _programs(results: dict[str, Any]) -> list[str]:
    rows = []
    for row in results["programs"]:
        macros = " ".join(f"{name}={value}" for name, value in row["macros"].items())
        seconds = "failed" if "error" in row else f"{row['seconds']:.2f}"
        rows.append((row["stem"], macros, seconds, short(row["error"]) if "error" in row else said(row["said"])))
    return _rows("| program | built with | s, no cache | the compiler says |", rows)


def _bits(results: dict[str, Any]) -> list[str]:
    rows = []
    for row in results["bits"]:
        if "error" in row:
            rows.append((row["workload"], "failed", short(row["error"])))
            continue
        parts = row["parts"]
        apart = [f"{name.strip()}: {difference(part)}" for name, part in parts.items() if difference(part)]
        said = ", ".join(apart)
        rows.append((row["workload"], f"{len(parts) - len(apart)} of {len(parts)}", short(said)))
    return _rows("| bits, at 256 px | parts that are equal | what differs |", rows)


def difference(part: dict[str, Any] | None) -> str:
    """What `differences` says of a part, in words; empty where it is equal."""
    if part is None:
        return "other shape"
    if not part["share"]:
        return ""
    first, second = part["values"]
    return f"{part['share']:.3%} of pixels, first at {part['place']}: {first!r} and {second!r}"


def _tests(results: dict[str, Any]) -> list[str]:
    tests = results["tests"]
    if tests is None:
        return []
    if "error" in tests:
        return [f"Tests: {short(tests['error'])}", ""]
    ran = tests["passed"] + tests["failed"] + tests["skipped"]
    ended = f"; {tests['ended']} at {ran} of {tests['collected']}" if tests["ended"] else ""
    counts = ", ".join(f"{tests[o]} {o}" for o in ("passed", "failed", "skipped"))
    what = f"Tests of kernels and goldens on the device, {tests['files']} files, {tests['seconds']:.0f} s"
    line = f"{what}: {counts}{ended}."
    return [line, "", *_rows("| test that failed | why |", ((short(t), w) for t, w in tests["failures"]))]


def _left_out(results: dict[str, Any]) -> list[str]:
    if not results["skipped"]:
        return []
    return ["Skipped, because of the time limit or a missing device: " + "; ".join(results["skipped"]) + ".", ""]
