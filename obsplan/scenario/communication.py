"""What aid vehicles hear of AUVs: reports that come with ranges, late or not at all; throughput."""

from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from obsplan.quantities import LENGTH, SHARE, SLOT, THROUGHPUT
from obsplan.scenario.base import Table

SILENT = "none"
MOST_IN_FLIGHT = 60  # reports, each of which is followed step by step until it arrives


class CommunicationTable(Table):
    """What aid vehicles hear of the AUVs; by default an estimate with every range that comes."""

    reports: Literal["with-ranges", "none"] = Field(
        default="with-ranges",
        description="whether AUVs' estimates come with their ranges, or nothing is heard of them, "
        "as where beacons broadcast one way",
    )
    latency: Annotated[float, SLOT] = Field(
        default=0.0, description="how old a report is when it arrives [s], a multiple of time_step"
    )
    loss: Annotated[float, SHARE] = Field(
        default=0.0, description="probability that a report is lost whose range came"
    )
    half_distance: Annotated[float | None, LENGTH] = Field(
        default=None, description="at which half of the others are lost [m]; default: none are"
    )
    throughput: Annotated[float | None, THROUGHPUT] = Field(
        default=None, description="at no distance [bit/s]; none is left beyond ranging.reach"
    )
    throughput_half_distance: Annotated[float | None, LENGTH] = Field(
        default=None, description="at which half of it is left [m]; default: it does not fall"
    )


def check_communication(
    communication: CommunicationTable, knowledge: str, doubt: str
) -> tuple[str, str] | None:
    """What of a scenario's communication cannot be: the key, and a sentence with the remedy."""
    silent = communication.reports == SILENT
    for key in ("latency", "loss", "half_distance"):
        if silent and getattr(communication, key):
            return f"communication.{key}", (
                'says how reports come, and reports = "none" that none do: leave out one of them'
            )
    if silent and knowledge.startswith("estimate"):
        return "planner.knowledge", (
            f'"{knowledge}" is what AUVs report, and communication.reports = "none": planners '
            'would only dead-reckon from the first estimate; set planner.knowledge = "survey"'
        )
    if silent and doubt != "none":
        return "planner.doubt", (
            f'"{doubt}" of AUVs come with what they report, and communication.reports = "none": '
            'set planner.doubt = "none"'
        )
    if communication.throughput_half_distance and not communication.throughput:
        return "communication.throughput_half_distance", (
            "says how a throughput falls that is not given: give communication.throughput, too"
        )
    return None


def most_in_flight(latency: float, *, interval: float, jitter: float, in_round: int) -> int:
    """How many reports of an AUV are on their way at most, so many being made in each round."""
    rounds = np.floor((latency + jitter) / interval + 1e-6) + 1
    return int(in_round * rounds)
