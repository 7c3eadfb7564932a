"""What a campaign is made of: scenarios x planners x a grid of settings, each once per seed."""

import hashlib
import json
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

from obsplan.campaign.code import code_hash
from obsplan.plugins import fingerprint, is_own
from obsplan.scenario import Scenario, load
from obsplan.types import ObsplanError

NOT_TO_VARY = {
    "seed": "give --runs and --seed",
    "name": "give several scenario files",
    "description": "it changes nothing",
    "planner": "give --planners, or vary planner.gamma and its like",
    "auv": "vary auv.0.speed and its like",
    "export": "it changes nothing that a campaign measures",
}
GREATEST_SEED = 2**63 - 1  # that the store's integers hold
BLOCK = 1_000_000  # seeds of each scenario, where scenarios share none


@dataclass(frozen=True, kw_only=True)
class Cell:
    """One scenario under one planner with one choice of settings: flown once per seed.

    ``content`` is all that a worker needs, on whatever host. ``key`` names the content, and the
    version and code that fly it, so that with a seed it names a mission; ``base`` names, likewise,
    the scenario before planner and settings are put over it.
    """

    scenario: str
    planner: str
    settings: tuple[str, ...]  # key=value of each varied key
    content: str  # the resolved scenario as JSON
    key: str
    base: str
    seeds: range

    @property
    def label(self) -> str:
        """What a reader knows it by."""
        return ", ".join((self.scenario, self.planner, *self.settings))


def plan_cells(
    scenarios: Sequence[str],
    *,
    planners: Sequence[str] = (),
    vary: Sequence[str] = (),
    runs: int = 1,
    seed: int | None = None,
    independent: bool = False,
) -> tuple[Cell, ...]:
    """Check every combination before anything is flown.

    Parameters
    ----------
    scenarios
        Names of shipped scenarios, or paths of files.
    planners
        By name; default: each scenario's own.
    vary
        ``table.key=a,b,c`` each; all combinations are made. A list is one value:
        ``environment.current=[0.2,0.0],[0.4,0.0]``.
    runs
        Seeds per combination; the same for every planner and setting of a scenario, so that they
        meet the same noise.
    seed
        The first of them; default: the scenario's.
    independent
        No two scenarios share a seed: each begins as far after it as `block_of` its name says.

    Raises
    ------
    ObsplanError
        What the user gave is wrong; one sentence with the place, the value and the remedy.
    """
    if runs < 1:
        raise ObsplanError(f"--runs must be at least 1 seed, got {runs}")
    grid = [*product(*(values_of(text) for text in vary))]
    cells: dict[str, Cell] = {}
    named: dict[str, tuple[str, str]] = {}
    for source in dict.fromkeys(scenarios):
        plain = load(source)
        name, base = plain.table.name, key_of(content_of(plain))
        if named.setdefault(name, (source, base))[1] != base:
            raise ObsplanError(
                f'{named[name][0]} and {source} differ but are both named "{name}"; '
                "change `name` in one of them"
            )
        first = plain.table.seed if seed is None else seed
        seeds = seeds_of(first + (block_of(name, first, runs) if independent else 0), runs)
        for planner, settings in product(dict.fromkeys(planners) or (None,), grid):
            cell = cell_of(
                loaded(source, planner, settings), base=base, settings=settings, seeds=seeds
            )
            cells.setdefault(cell.key, cell)
    return tuple(cells.values())


def values_of(text: str) -> list[str]:
    """Settings ``key=value``, one for each value of ``key=a,b,c``."""
    key, equals, values = text.partition("=")
    pieces = split(values)
    if not equals or not key.strip() or not all(piece.strip() for piece in pieces):
        raise ObsplanError(
            f'--vary "{text}" lacks a key or a value; '
            "write table.key=a,b,c, for example cna.speed=1.0,1.5,2.0"
        )
    name = key.strip()
    fixed = "export" if name.startswith("export.") else name
    if fixed in NOT_TO_VARY:
        raise ObsplanError(
            f'--vary "{text}": {name} is not a setting to vary; {NOT_TO_VARY[fixed]}'
        )
    return [f"{key.strip()}={piece.strip()}" for piece in pieces]


def split(values: str) -> list[str]:
    """Split at the commas outside brackets and quotes."""
    pieces, depth, quoted = [""], 0, False
    for letter in values:
        quoted ^= letter == '"'
        depth += 0 if quoted else (letter in "[{") - (letter in "]}")
        if letter == "," and depth == 0 and not quoted:
            pieces.append("")
        else:
            pieces[-1] += letter
    return pieces


def seeds_of(first: int, runs: int) -> range:
    """The seeds of a campaign."""
    if first + runs - 1 > GREATEST_SEED:
        raise ObsplanError(
            f"seed {first + runs - 1} is beyond {GREATEST_SEED}; give a smaller --seed"
        )
    return range(first, first + runs)


def block_of(name: str, first: int, runs: int) -> int:
    """How many seeds after the first those of a scenario begin, so that no other has them.

    The checksum CRC-32 of its name counts blocks of a million seeds.

    Raises
    ------
    ObsplanError
        The seeds would reach into the next block.
    """
    if first + runs > BLOCK:
        raise ObsplanError(
            f"seed {first + runs - 1} is beyond the {BLOCK} that each scenario of a suite has; "
            "give a smaller --seed"
        )
    return BLOCK * zlib.crc32(name.encode())


def loaded(source: str, planner: str | None, settings: Sequence[str]) -> Scenario:
    """A scenario with its planner and settings replaced."""
    try:
        return load(source, planner=planner, settings=settings)
    except ObsplanError as error:
        raise ObsplanError(str(error).replace("--set ", "--vary ")) from None


def cell_of(scenario: Scenario, *, base: str, settings: Sequence[str], seeds: range) -> Cell:
    """The cell of a checked scenario."""
    content = content_of(scenario)
    return Cell(
        scenario=scenario.table.name,
        planner=scenario.table.planner.kind,
        settings=tuple(settings),
        content=content,
        key=key_of(content),
        base=base,
        seeds=seeds,
    )


def content_of(scenario: Scenario) -> str:
    """All that decides a mission but its seed: the same text wherever the scenario came from."""
    data = {
        key: value
        for key, value in scenario.resolved().items()
        if key not in ("description", "export", "seed")
    }
    return json.dumps(data, sort_keys=True, separators=(",", ":"))


def key_of(content: str) -> str:
    """SHA-256 of the content, the version, the code that flies it, and the files of own classes."""
    from obsplan import __version__

    own = own_kinds(json.loads(content))
    parts = [__version__, code_hash(), content, *([fingerprint(own)] if own else [])]
    return hashlib.sha256("\0".join(parts).encode()).hexdigest()


def own_kinds(data: Any) -> list[str]:
    """Kinds that name users' classes, anywhere in a scenario."""
    if isinstance(data, list):
        return [kind for item in data for kind in own_kinds(item)]
    if not isinstance(data, dict):
        return []
    here = [data["kind"]] if is_own(data.get("kind")) else []
    return [*here, *own_kinds([*data.values()])]
