"""All measurements of a run as a table, where its tracks cannot hold them."""

from collections.abc import Iterator

from obsplan.report.files import BLOCK, rounded, table_csv
from obsplan.run import Run
from obsplan.scenario import Scenario
from obsplan.sensors import Range
from obsplan.simulation.features import Features
from obsplan.simulation.taped import SPEED_UNIT, UNITS, Drawn, measurements, sensors_of
from obsplan.spelling import inert

COLUMNS = ("sent_s", "received_s", "auv", "beacon", "sensor", "value", "unit")


def has_more_measured(scenario: Scenario) -> bool:
    """Whether ``tracks.csv`` cannot hold all that is measured, or when it was sent."""
    has, sensor = Features.of(scenario), scenario.range_sensor
    travelled = isinstance(sensor, Range) and sensor.timing != "instant"
    return len(scenario.beacons) > 1 or has.bearing or travelled or has.repeated or has.logged > 0


def measurements_csv(run: Run) -> Iterator[str]:
    """What AUVs measured besides headings, as `obsplan.Tape` has it, in pieces."""
    yield table_csv([COLUMNS])
    drawn, sensors = Drawn.of(run), [*sensors_of(run.scenario)]
    auvs = [inert(name) for name in run.names]
    beacons = [*(inert(beacon.name) for beacon in run.scenario.beacons), ""]  # the last: of none
    for begin in range(0, run.time.size, BLOCK):
        came = measurements(run, drawn, slice(begin, begin + BLOCK))
        yield table_csv(
            zip(
                rounded(came.sent),
                rounded(came.received),
                [auvs[i] for i in came.auv],
                [beacons[i] for i in came.beacon],
                [inert(sensors[i]) for i in came.sensor],
                rounded(came.value),
                [UNITS.get(sensors[i], SPEED_UNIT) for i in came.sensor],
                strict=True,
            )
        )
