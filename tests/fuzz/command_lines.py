"""Command lines that are wrong or extreme, by seed."""

import random
from collections.abc import Iterator

from fuzz.scenarios import NUMBERS, PLANNERS, POND, TEXTS, as_toml, nested, places

COMMANDS = {  # and their options
    "run": ("--seed", "--planner", "--set", "--set", "--set", "--out", "--no-bound"),
    "compare": ("--seed", "--runs", "--planners", "--set", "--set", "--out", "--no-bound"),
    "campaign": (
        "--seed",
        "--runs",
        "--planners",
        "--vary",
        "--vary",
        "--out",
        "--out",
        "--workers",
    ),
    "campaign-report": (),
    "thesis": ("--runs", "--seed", "--out"),
    "new": ("--out",),
    "schema": ("--json",),
    "rum": ("--out",),
}
ANY = ("--x", "--version", "--help", "-o", "--", "--set", "--runs")
FILES = (
    "s.toml",
    "./s.toml",
    "pond.csv",
    "none.toml",
    "none.csv",
    ".",
    "/",
    "/dev/null",
    "/dev/full/x.toml",
    "harbor-survey",
    "suite",
    "",
)
KEYS = (
    "cna.speed",
    "auv.0.speed",
    "auv.99.speed",
    "auv.0.survey.legs",
    "planner.kind",
    "planner.gamma",
    "seed",
    "ranging.interval",
    "a",
    "",
)


def command_lines(seed: int, count: int) -> Iterator[list[str]]:
    """So many command lines without the program's name; none flies anything long."""
    rng = random.Random(seed)
    for _ in range(count):
        command = rng.choice(("run", "run", "compare", "campaign", "new", *COMMANDS))
        words = [command, rng.choice((*FILES[:4], *FILES, text(rng)))]
        for _ in range(rng.choice((0, 1, 1, 2, 3))):
            option = rng.choice(COMMANDS[command] * 3 + ANY)
            words += [option, argument(option, rng)][: rng.choice((1, 2, 2, 2, 2, 2))]
        yield [
            word.replace("\0", "?")
            .encode("utf-8", "surrogatepass")
            .decode("utf-8", "surrogateescape")
            for word in words
        ]


def argument(option: str, rng: random.Random) -> str:
    """A value for an option."""
    if option in ("--set", "--vary") and rng.random() < 0.9:
        known = [".".join(path) for path in paths()]
        key = rng.choice((*known, *KEYS, ".".join("a" * rng.choice((3, 50, 3000))), text(rng)))
        return f"{key}{rng.choice(('=', '=', '=', '=', '', '=='))}{value(rng)}"
    if option in ("--planner", "--planners") and rng.random() < 0.7:
        return ",".join(str(rng.choice(PLANNERS)["kind"]) for _ in range(rng.choice((1, 2))))
    return rng.choice((str(rng.choice(NUMBERS)), text(rng), "1", "2", "out"))


def value(rng: random.Random) -> str:
    """A value in TOML, or nearly."""
    kind = rng.random()
    if kind < 0.6:
        return as_toml(rng.choice(NUMBERS))
    return nested(rng.choice((3, 30, 600)), rng) if kind < 0.7 else text(rng)


def text(rng: random.Random) -> str:
    """A text, at times of a thousand letters."""
    return rng.choice(TEXTS) * rng.choice((1, 1, 1, 40))


def paths() -> list[list[str]]:
    """Keys of the sound scenario, as the command line has them."""
    found = [["cna", "speed"]]
    for holder, key in places(POND):
        found += [
            [name, str(key)]
            for name in ("cna", "ranging", "planner", "environment")
            if holder is POND[name]
        ]
        found += [["auv", "0", str(key)] for auv in POND["auv"] if holder is auv]
    return found
