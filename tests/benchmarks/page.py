"""Write docs/speed.md from what pytest-benchmark recorded.

``python -m pytest tests/benchmarks -o addopts= --benchmark-only --benchmark-json speed.json``,
then ``python tests/benchmarks/page.py speed.json > docs/speed.md``.
"""

import json
import sys
from itertools import groupby
from pathlib import Path

import obsplan

HEAD = """# How fast it is

Everything here was measured in one run on one machine. A table has what is to be compared: a rival, the
same without a compiler, or the same for more AUVs, steps or points. Read the ratios, which are to its first row.

Machine: {machine}, Python {python}. {date}, obsplan {version}.

To repeat it on yours (some minutes; keep the machine quiet):

```
python -m pip install -e '.[test,bench]'
python -m pytest tests/benchmarks -o addopts= --benchmark-only --benchmark-json speed.json
python tests/benchmarks/page.py speed.json > docs/speed.md
```

"""
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


def page(recorded):
    machine = recorded["machine_info"]
    cpu = machine["cpu"]
    told = f"{cpu['brand_raw']}, {cpu['count']} cores"
    groups = groupby(recorded["benchmarks"], key=group)
    tables = [table(title, list(benchmarks)) for title, benchmarks in groups]
    head = HEAD.format(
        machine=told,
        python=machine["python_version"],
        date=recorded["datetime"][:10],
        version=obsplan.__version__,
    )
    return head + "\n\n".join(tables) + "\n"


def group(benchmark):
    return benchmark["group"] or words(benchmark)


if __name__ == "__main__":
    recorded = json.loads(Path(sys.argv[1]).read_text(encoding="utf-8"))
    recorded["benchmarks"].sort(key=lambda one: (module(one), group(one)))
    sys.stdout.write(page(recorded))
