"""Write docs/speed.md from what pytest-benchmark recorded, in one file or several.

``python -m pytest tests/benchmarks -o addopts= --benchmark-only --benchmark-timer=time.process_time
--benchmark-json speed.json``, then ``python tests/benchmarks/page.py speed.json > docs/speed.md``.
"""

import json
import sys
from itertools import groupby
from pathlib import Path

import obsplan

HEAD = """# How fast it is

CPU time (that of the command line by the clock on the wall), each table in one run. A table has what is to be
compared: a rival, the same without a compiler, or the same for more AUVs, steps or points. Read the ratios,
which are to its first row: the machine had other work to do, which makes times longer by half and more, and
medians more than leasts.

Machine: {machine}, Python {python}. {date}, obsplan {version}.

To repeat it on yours (some minutes):

```
python -m pip install -e '.[test,bench]'
python -m pytest tests/benchmarks -o addopts= --benchmark-only --benchmark-timer=time.process_time --benchmark-json speed.json
python tests/benchmarks/page.py speed.json > docs/speed.md
```

{decisions}

"""
DECISIONS = """## decisions of the default planner

`{module}`: one mission of each scenario of the suite, seed {seed}. Of its decisions the middle one, and the one in a
hundred that takes longest. Without limits a search is one call of machine code; with them numpy chooses what is kept
after each stage.

| scenario | AUVs | decisions | p50 | p99 | mission |
| --- | --- | --- | --- | --- | --- |
{rows}"""
CORES = {1: "one core", 2: "two cores"}
UNITS = ((1.0, "s"), (1e-3, "ms"), (1e-6, "µs"))


def duration(seconds):
    """A time with three digits and its unit."""
    scale, unit = next((u for u in UNITS if seconds >= u[0]), UNITS[-1])
    return f"{seconds / scale:.3g} {unit}"


def words(benchmark):
    """What was timed."""
    name = benchmark["name"].removeprefix("test_")
    name, _, parameters = name.partition("[")
    told = name.replace("_", " ")
    return f"{told} ({parameters.rstrip(']')})" if parameters else told


def module(benchmark):
    return Path(benchmark["fullname"].partition("::")[0]).name


def table(title, benchmarks):
    """One group, quickest first."""
    benchmarks = sorted(benchmarks, key=lambda one: one["stats"]["median"])
    least = benchmarks[0]["stats"]["median"]
    lines = [f"## {title}", "", f"`{module(benchmarks[0])}`", ""]
    lines += ["| what | least | median | ratio |", "| --- | --- | --- | --- |"]
    for one in benchmarks:
        quickest, median = one["stats"]["min"], one["stats"]["median"]
        cells = words(one), duration(quickest), duration(median), f"{median / least:.3g}"
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def decisions(benchmarks):
    """The table of single decisions."""
    rows = []
    for one in benchmarks:
        of = one["extra_info"]["decisions"]
        name = one["param"].rpartition("/")[2]
        counts = name, str(of["AUVs"]), str(of["decisions"])
        cells = *counts, *map(duration, (of["p50"], of["p99"], one["stats"]["min"]))
        rows.append(f"| {' | '.join(cells)} |")
    seed = benchmarks[0]["extra_info"]["seed"]
    return DECISIONS.format(module=module(benchmarks[0]), seed=seed, rows="\n".join(rows))


def page(recorded):
    machine = recorded["machine_info"]
    cpu = machine["cpu"]
    cores = CORES.get(cpu["count"], f"{cpu['count']} cores")
    told = f"{cpu['brand_raw']}, {cores}"
    single = [one for one in recorded["benchmarks"] if "decisions" in one["extra_info"]]
    others = [one for one in recorded["benchmarks"] if one not in single]
    groups = groupby(others, key=group)
    tables = [table(title, list(benchmarks)) for title, benchmarks in groups]
    head = HEAD.format(
        machine=told,
        python=machine["python_version"],
        date=recorded["datetime"][:10],
        version=obsplan.__version__,
        decisions=decisions(single),
    )
    return head + "\n\n".join(tables) + "\n"


def group(benchmark):
    return benchmark["group"] or words(benchmark)


if __name__ == "__main__":
    recorded, *more = [json.loads(Path(name).read_text(encoding="utf-8")) for name in sys.argv[1:]]
    for one in more:
        recorded["benchmarks"] += one["benchmarks"]
    recorded["benchmarks"].sort(key=lambda one: (module(one), group(one)))
    sys.stdout.write(page(recorded))
