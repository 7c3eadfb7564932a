"""A vehicle that stores the items of a mission, so many and no more, and a ground station that uploads them.

Both speak pymavlink's MAVLink over a loopback socket, as https://mavlink.io/en/services/mission.html
has it. Every wait ends.
"""

import socket
import threading

import numpy as np
import pytest
from pymavlink.dialects.v20 import common
from pymavlink.mavwp import MAVWPLoader

WAIT = 5.0  # [s] for any one message
MOST_MESSAGES = 2000
VEHICLE, STATION = 1, 255
ACCEPTED, NO_SPACE = common.MAV_MISSION_ACCEPTED, common.MAV_MISSION_NO_SPACE


class Link:
    """One end of a MAVLink connection over UDP on this machine."""

    def __init__(self, system):
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.settimeout(WAIT)
        self.mav = common.MAVLink(None, srcSystem=system, srcComponent=1)
        self.peer = None

    def send(self, message):
        self.socket.sendto(message.pack(self.mav), self.peer)

    def receive(self):
        """The next message; TimeoutError if none comes."""
        data, _ = self.socket.recvfrom(1024)
        (message,) = self.mav.parse_buffer(data)
        return message


class Vehicle(threading.Thread):
    """Asks for one item after the other and keeps them, or says that it has no room."""

    def __init__(self, link, room):
        super().__init__(daemon=True)
        self.link, self.room, self.stored, self.fault = link, room, [], None

    def run(self):
        try:
            count = self.link.receive()
            assert count.get_type() == "MISSION_COUNT"
            if count.count > self.room:
                self._acknowledge(common.MAV_MISSION_NO_SPACE)
                return
            for seq in range(min(count.count, MOST_MESSAGES)):
                self.link.send(common.MAVLink_mission_request_int_message(STATION, 1, seq))
                item = self.link.receive()
                assert (item.get_type(), item.seq) == ("MISSION_ITEM_INT", seq)
                self.stored.append(item)
            self._acknowledge(common.MAV_MISSION_ACCEPTED)
        except Exception as error:
            self.fault = error

    def _acknowledge(self, result):
        self.link.send(common.MAVLink_mission_ack_message(STATION, 1, result))


def upload(path, room):
    """What the vehicle answers in the end, and what it has stored."""
    loader = MAVWPLoader()
    items = [loader.wp(i) for i in range(loader.load(str(path)))]
    station, boat = Link(STATION), Link(VEHICLE)
    station.peer, boat.peer = boat.socket.getsockname(), station.socket.getsockname()
    vehicle = Vehicle(boat, room)
    vehicle.start()
    try:
        station.send(common.MAVLink_mission_count_message(VEHICLE, 1, len(items)))
        for _ in range(MOST_MESSAGES):
            message = station.receive()
            if message.get_type() == "MISSION_ACK":
                return message.type, vehicle.stored, items
            station.send(as_int(items[message.seq]))
        pytest.fail("the upload does not end")
    finally:
        vehicle.join(WAIT)
        for link in (station, boat):
            link.socket.close()
        assert vehicle.fault is None


def as_int(item):
    """An item as the protocol sends it: degrees times 1e7."""
    return common.MAVLink_mission_item_int_message(
        VEHICLE,
        1,
        item.seq,
        item.frame,
        item.command,
        item.current,
        item.autocontinue,
        item.param1,
        item.param2,
        item.param3,
        item.param4,
        round(item.x * 1e7),
        round(item.y * 1e7),
        item.z,
    )


def figures(items):
    """All that an item says, but its place."""
    names = ("seq", "frame", "command", "current", "autocontinue")
    params = ("param1", "param2", "param3", "param4")
    return np.array([[getattr(item, name) for name in (*names, *params)] for item in items])


def assert_stored_as_in(path, stored):
    """The places are those of a waypoint file to a unit of MAVLink's, 1e-7 degrees."""
    lines = path.read_text().splitlines()[1:]
    places = np.array([[float(cell) for cell in line.split("\t")[8:10]] for line in lines])
    got = np.array([(item.x * 1e-7, item.y * 1e-7) for item in stored])
    np.testing.assert_allclose(got, places, rtol=0, atol=1e-7)
