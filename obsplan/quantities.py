"""What a number that a user gives may be: a range, its unit, and the reason for it, each once.

A field of a table, or of a dataclass that stands for one, carries its `Quantity` in its type,
``Annotated[float, "length [m]", LENGTH]``. The tables check it when a file is read, the
dataclasses by `check_quantities` when they are made.
"""

from dataclasses import dataclass
from functools import lru_cache
from numbers import Real
from typing import Annotated, Any, Literal, get_args, get_origin, get_type_hints


@dataclass(frozen=True, slots=True)
class Quantity:
    """From the least to the greatest number allowed, both included, and why there is an end."""

    least: float | int
    greatest: float | int
    unit: str
    reason: str

    def __str__(self) -> str:
        unit = f" {self.unit}" if self.unit else ""
        least, greatest = plain_digits(self.least), plain_digits(self.greatest)
        return f"from {least} to {greatest}{unit} ({self.reason})"

    def __contains__(self, value: Any) -> bool:
        """Whether a number, Python's or numpy's, is in the range; nan never is."""
        number = value  # Real promises no order, numbers have one
        return isinstance(value, Real) and bool(self.least <= number <= self.greatest)

    def check(self, value: Any) -> Any:
        """Give back None, or a number in the range.

        Raises
        ------
        ValueError
            One sentence with the range, the reason and the remedy.
        """
        if value is not None and value not in self:
            raise ValueError(f"must be {self}: correct it")
        return value

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> Any:
        from pydantic_core import core_schema

        return core_schema.no_info_after_validator_function(self.check, handler(source))

    def __get_pydantic_json_schema__(self, schema: Any, handler: Any) -> dict[str, Any]:
        return handler(schema) | {"minimum": self.least, "maximum": self.greatest}


def plain_digits(value: float | int) -> str:
    """A limit as people write it, to a millionth, without an exponent."""
    return f"{value:.6f}".rstrip("0").removesuffix(".")


def quantity_of(hint: Any) -> Quantity | None:
    """The first quantity in a type, also in that of a list's entries."""
    if get_origin(hint) is Annotated:
        marks = (mark for mark in hint.__metadata__ if isinstance(mark, Quantity))
        found = next(marks, None)
        return found or quantity_of(get_args(hint)[0])
    return next((found for part in get_args(hint) if (found := quantity_of(part))), None)


def check_quantities(made: object) -> None:
    """Refuse a number that is out of the range its dataclass's field has, or a name that is none.

    Raises
    ------
    ValueError
        Naming the field, the range or the choices, and the value.
    """
    check_choices(made)
    for name, quantity in _quantities(type(made)).items():
        value = getattr(made, name)
        for number in value if isinstance(value, tuple | list) else (value,):
            if number is not None and number not in quantity:
                raise ValueError(f"{name} must be {quantity}, got {number}")


def check_choices(made: object) -> None:
    """Refuse a value that is none of the names that its dataclass's field may have.

    Raises
    ------
    ValueError
        Naming the field, the choices and the value.
    """
    for name, choices in _choices(type(made)).items():
        given = getattr(made, name)
        if given not in choices:
            raise ValueError(f'{name} must be one of {", ".join(choices)}, got "{given}"')


@lru_cache(maxsize=64)
def _choices(cls: type) -> dict[str, tuple[str, ...]]:
    """The fields that are one of a few names."""
    hints = get_type_hints(cls)
    return {name: get_args(hint) for name, hint in hints.items() if get_origin(hint) is Literal}


@lru_cache(maxsize=64)
def _quantities(cls: type) -> dict[str, Quantity]:
    hints = get_type_hints(cls, include_extras=True)
    found = {name: quantity_of(hint) for name, hint in hints.items()}
    return {name: quantity for name, quantity in found.items() if quantity is not None}


# places and lengths
POSITION = Quantity(-100e3, 100e3, "m", "the map ends 100 km from the origin")
LENGTH = Quantity(1e-3, 100e3, "m", "a millimetre to what the map holds")
DISTANCE = Quantity(0.0, 100e3, "m", "what the map holds")
TURN_RADIUS = Quantity(0.01, 10e3, "m", "a model boat's to more than any ship's")
BEARING = Quantity(-3600.0, 3600.0, "degrees", "more than ten turns say no more than one")

# motion
VESSEL_SPEED = Quantity(1e-3, 50.0, "m/s", "slower is a station, and no vessel is faster")
AUV_SPEED = Quantity(0.0, 10.0, "m/s", "no survey AUV is faster")
AUV_SURGE = Quantity(-10.0, 10.0, "m/s", "no survey AUV is faster, ahead or astern")
CURRENT = Quantity(-10.0, 10.0, "m/s", "no tidal stream is faster")
TIDE_PERIOD = Quantity(60.0, 2_678_400.0, "s", "a minute to a month")
TURN_ACCELERATION = Quantity(1e-6, 100.0, "rad/s^2", "no vessel turns harder")

# time
TIME_STEP = Quantity(1e-3, 60.0, "s", "a millisecond to a minute, in which a vehicle turns")
DURATION = Quantity(1e-3, 2_678_400.0, "s", "up to a month")
INTERVAL = Quantity(1e-3, 86_400.0, "s", "a millisecond to a day")
INSTANT = Quantity(0.0, 2_678_400.0, "s", "up to a month")
HOLD = Quantity(0.0, 86_400.0, "s", "who waits for more than a day is moored")

# errors, as standard deviations
RANGE_SIGMA = Quantity(1e-3, 100e3, "m", "no acoustic range is better than a millimetre")
SQUARED_RANGE_SIGMA = Quantity(
    1e-3, 10e9, "m^2", "that of a millimetre at half a metre, to the square of what the map holds"
)
COMPASS_SIGMA = Quantity(1e-3, 180.0, "degrees", "no compass is better than 0.001 degrees")
COMPASS_BIAS = Quantity(-180.0, 180.0, "degrees", "a compass that errs by half a turn points back")
ANGLE_SIGMA = Quantity(0.0, 360.0, "degrees", "a whole turn is to know nothing")
SPEED_SIGMA = Quantity(0.0, 50.0, "m/s", "no vessel is faster")
LOG_SIGMA = Quantity(1e-4, 50.0, "m/s", "no log is better than 0.1 mm/s")
POSITION_WALK = Quantity(0.0, 100.0, "m/sqrt(s)", "100 m in a second is no dead reckoning")
POSITION_WALK_PER_METER = Quantity(0.0, 10.0, "m/sqrt(m)", "who errs more has no odometry")
SPEED_WALK = Quantity(0.0, 10.0, "m/s/sqrt(s)", "no survey AUV is faster than that")

# sound and depth
SOUND_SPEED = Quantity(1300.0, 1700.0, "m/s", "that of no water is outside")
DEPTH = Quantity(0.0, 12_000.0, "m", "the surface to the deepest sea")
DEPTH_SIGMA = Quantity(0.0, 1000.0, "m", "who errs more knows no depth")
GROWTH = Quantity(0.0, 1.0, "m/m", "an error of the whole distance is no range")
TURNAROUND = Quantity(0.0, 60.0, "s", "a transponder that waits longer is off")
TIME_SIGMA = Quantity(0.0, 10.0, "s", "15 km by the speed of sound")
CLOCK_OFFSET = Quantity(-10.0, 10.0, "s", "15 km by the speed of sound")
CLOCK_DRIFT = Quantity(-1e-3, 1e-3, "s/s", "a quartz without any care does better")
GATE = Quantity(0.0, 1000.0, "", "standard deviations; one that never closes is 0")
SHARE = Quantity(0.0, 1.0, "", "a probability")
CARRIER = Quantity(0, 63, "", "aid vehicles are counted from 0")
SLOT = Quantity(0.0, 3600.0, "s", "no acoustic network waits for an hour")
THROUGHPUT = Quantity(1e-3, 1e9, "bit/s", "no modem for water sends faster")

# weights without a unit
WEIGHT = Quantity(0.0, 1e6, "", "a weight of a million leaves the others no say")

LINK_WEIGHT = Quantity(0.0, 1e9, "m^2 or -", "more than the square of what a survey spans")
CHANGE_WEIGHT = Quantity(0.0, 1e9, "", "what is penalised more does not change")
CIRCLES = Quantity(0.01, 1000.0, "", "a share of one to what takes an hour")

# counts
SEED = Quantity(0, 2**53 - 1, "", "whole numbers that every program can read")
WHOLE = Quantity(-(2**53) + 1, 2**53 - 1, "", "whole numbers that every program can read")
LEGS = Quantity(1, 10_000, "", "a survey of more takes weeks")
CANDIDATES = Quantity(2, 1001, "", "more candidate turns differ by less than a rudder does")
BRANCHES = Quantity(3, 201, "", "more candidate turns differ by less than a rudder does")
PATIENCE = Quantity(1, 1000, "", "a filter that waits longer is lost meanwhile")
HYPOTHESES = Quantity(1, 100, "", "more are not followed in the time of a step")
STAGES = Quantity(1, 200, "", "more are not looked ahead in the time of a decision")
TURNS = Quantity(2, 100, "", "a program with more is not solved in the time of a decision")
BEAM_WIDTH = Quantity(1, 10_000, "", "more are not kept in the time of a decision")
STARTS = Quantity(1, 10_000, "", "more take days")
ITERATIONS = Quantity(1, 100_000, "", "what has not converged by then does not")
GAUSS_NEWTON = Quantity(1, 20, "", "what has not converged by then does not")
RUNS = Quantity(1, 1_000_000, "", "more are flown by nobody")
