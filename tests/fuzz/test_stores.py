"""Campaign stores damaged by seed: no figure changes unseen, and what is lost is flown again."""

import random
from collections import Counter
from collections.abc import Callable

import pytest
from campaigns import complete_campaign, instant_crew, tables
from fuzz.trying import SEED, fault_of_form, limited, share, told

from obsplan import ObsplanError, load_campaign
from obsplan.campaign import fly_campaign
from obsplan.campaign.faults import FILE

PAGE = 4096  # bytes that SQLite writes at once


def flip(content: bytearray, rng: random.Random) -> None:
    """Change one bit, in a third of cases in the page that describes the file."""
    within = PAGE if rng.random() < 1 / 3 else len(content)
    content[rng.randrange(within)] ^= 1 << rng.randrange(8)


def cut(content: bytearray, rng: random.Random) -> None:
    """Lose the end."""
    del content[rng.choice((0, 50, PAGE, rng.randrange(len(content)))) :]


def scribble(content: bytearray, rng: random.Random) -> None:
    """Write what is no part of it over some bytes."""
    start, size = rng.randrange(len(content)), rng.choice((1, 8, 100, PAGE))
    content[start : start + size] = rng.randbytes(len(content[start : start + size]))


def lose_page(content: bytearray, rng: random.Random) -> None:
    """Have zeros where a page was."""
    start = rng.randrange(len(content) // PAGE) * PAGE
    content[start : start + PAGE] = bytes(PAGE)


def repeat_page(content: bytearray, rng: random.Random) -> None:
    """Have one page twice, in place of another."""
    source, target = (rng.randrange(len(content) // PAGE) * PAGE for _ in range(2))
    content[target : target + PAGE] = content[source : source + PAGE]


def change_digit(content: bytearray, rng: random.Random) -> None:
    """Have another digit in a text, such as the JSON of an AUV's figures."""
    digits = [i for i, byte in enumerate(content) if 48 <= byte < 58]
    content[rng.choice(digits)] = 48 + rng.randrange(10)


DAMAGES: tuple[Callable[[bytearray, random.Random], None], ...] = (
    flip,
    flip,
    flip,
    cut,
    scribble,
    lose_page,
    repeat_page,
    change_digit,
)


@pytest.mark.slow
def test_no_damage_changes_a_figure_unseen(tmp_path, monkeypatch):
    """The oracle is the tables before; digests are checked by what they must prevent."""
    instant_crew(monkeypatch)
    cells, out = complete_campaign(tmp_path), tmp_path / "out"
    healthy, exported = load_campaign(out), tables(out)
    content = (out / FILE).read_bytes()
    rng = random.Random(SEED)
    outcomes: Counter[str] = Counter()
    for _ in range(share(120)):
        damaged = bytearray(content)
        damage = rng.choice(DAMAGES)
        damage(damaged, rng)
        (out / FILE).write_bytes(damaged)
        seen = refusal(lambda: load_campaign(out))
        if seen is None:
            assert load_campaign(out).equals(healthy), damage
        report = []
        beyond = refusal(lambda to=report: to.append(fly_campaign(cells, out)))
        if beyond is None:
            assert tables(out) == exported, damage
        mended = bool(report and report[0].damage)
        if mended and report[0].damage.lost is not None:  # else nobody knows how many there were
            assert report[0].flown == report[0].damage.lost
        outcomes[became(seen, beyond, mended=mended)] += 1
    known = {"unharmed", "said and flown again", "said, beyond mending"}
    assert told("stores", outcomes, known) == []
    assert outcomes["said and flown again"] > share(120) / 5


def refusal(attempt: Callable[[], object]) -> str | None:
    """What is said of a store that cannot be used, None of one that can."""
    try:
        with limited():
            attempt()
    except ObsplanError as error:
        return str(error)
    return None


def became(seen: str | None, beyond: str | None, *, mended: bool) -> str:
    """What became of a damaged store, from what was said when it was read and flown again."""
    for said in filter(None, (seen, beyond)):
        fault = fault_of_form(said)
        if fault is not None or FILE not in said:
            return f"said {fault}: {said}"
    if beyond is not None:
        return "said, beyond mending" if seen else f"said only when flown: {beyond}"
    if mended:
        return "said and flown again" if seen else "mended, and unsaid when read"
    return "unharmed" if seen is None else f"said, and nothing was mended: {seen}"
