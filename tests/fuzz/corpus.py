"""Past failures, each the smallest of its kind: what crashed, hung, took all memory or was believed."""

SOUND = {
    "name": '"pond"',
    "time_step": "0.5",
    "duration": "12.0",
    "origin": "{lat = 47.6, lon = -122.3}",
    "cna": "{speed = 2.0, min_turn_radius = 5.0}",
    "auv": '[{speed = 1.0, survey = {kind = "lawnmower", legs = 2, length = 40.0, spacing = 10.0}}]',
    "ranging": "{interval = 2.0, sigma = 1.0}",
    "planner": '{kind = "stationary"}',
}
DIGITS = "1" + "0" * 4999


def pond(**changes: str) -> str:
    """The sound scenario with other values, as they stand in the file."""
    return "".join(f"{key} = {value}\n" for key, value in {**SOUND, **changes}.items())


SCENARIOS = {
    "integer of 5000 digits": pond(seed=DIGITS),
    "nested 800 deep": pond(auv="[" * 800 + "]" * 800),
    "nested tables beside an integer of 5000 digits": pond(
        seed=DIGITS, cna="{x = " * 400 + "1" + "}" * 400
    ),
    "infinitely many steps between pings": pond(time_step="1e-308"),
    "a mission shorter than a step": pond(duration="1e-10"),
    "start beyond the map": pond(cna="{speed = 2.0, min_turn_radius = 5.0, start = {x = 1e308}}"),
    "deviation the square of which is 0": pond(ranging="{interval = 2.0, sigma = 1e-300}"),
    "more candidates than an index holds": pond(
        planner='{kind = "gramian", turn_rates = 9223372036854775808}'
    ),
    "a thousand million legs": pond(
        auv='[{speed = 1.0, survey = {kind = "lawnmower", legs = 1000000000, length = 4.0, spacing = 1.0}}]'
    ),
    "horizon that native code never reaches": pond(
        planner='{kind = "trajectory", horizon = 1e308}'
    ),
    "aid vehicle slower than the current": pond(environment="{current = [5.0, 0.0]}"),
    "300 m/s": pond(cna="{speed = 300.0, min_turn_radius = 5.0}"),
    "name of 5000 letters": pond(name=f'"{"x" * 5000}"'),
    "name that begins a formula": pond(name='"=1+1"'),
    "name that breaks a line": pond(name='"a\\rb"'),
    "name that colours the terminal": pond(name='"\\u001b[31mred"'),
    "mission file that is a device": pond(
        auv='[{speed = 1.0, survey = {kind = "mission", file = "/dev/zero"}}]'
    ),
    "class in a module that runs something": pond(planner='{kind = "os:system"}'),
}

MISSIONS = {  # a suffix and a content
    "number with an underscore": (".csv", "x,y\n0,0\n1_0,0\n"),
    "last line that is cut": (".csv", "lat,lon\n47.6,-122.3\n47.601,-122.3\n47.602,-12"),
    "limit on another continent": (
        ".waypoints",
        "QGC WPL 110\n0\t1\t0\t16\t0\t0\t0\t0\t47.6\t-122.3\t0\t1\n"
        "1\t0\t3\t16\t0\t0\t0\t0\t47.601\t-122.3\t0\t1\n"
        "2\t0\t3\t16\t0\t0\t0\t0\t47.602\t-122.3\t0\t1\n"
        "3\t0\t3\t5001\t3\t0\t0\t0\t47.61\t-122.3\t0\t1\n"
        "4\t0\t3\t5001\t3\t0\t0\t0\t47.61\t-122.31\t0\t1\n"
        "5\t0\t3\t5001\t3\t0\t0\t0\t47.6\t12.31\t0\t1\n",
    ),
    "entities that grow": (
        ".gpx",
        '<!DOCTYPE g [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;">]><gpx>&b;</gpx>',
    ),
    "lists nested 5000 deep": (".geojson", "[" * 5000),
    "number of 5000 digits": (
        ".geojson",
        '{"type": "FeatureCollection", "features": ' + DIGITS + "}",
    ),
    "a command beyond the protocol": (
        ".waypoints",
        "QGC WPL 110\n0\t1\t0\t1e30\t0\t0\t0\t0\t47.6\t-122.3\t0\t1\n",
    ),
    "lanes beyond any number": (
        ".bhv",
        "Behavior = BHV_Waypoint\n{\npoints = format=lawnmower, x=1e308, y=0, width=60, height=30, lane_width=8\n}\n",
    ),
    "nothing": (".kml", ""),
}

COMMAND_LINES = {
    "value of 5000 digits": ["run", "s.toml", "--set", f"seed={DIGITS}"],
    "key of 3000 parts": ["run", "s.toml", "--set", f"{'.'.join('a' * 3000)}=1"],
    "value nested 800 deep": ["run", "s.toml", "--set", "cna=" + "[" * 800],
    "horizon that native code never reaches": [
        *("run", "s.toml", "--planner", "trajectory", "--set", "planner.horizon=1e308")
    ],
    "name longer than a file may have": ["run", "x" * 300],
    "folder longer than a file may have": ["run", "s.toml", "--out", "x" * 300],
    "file below a device": ["run", "/dev/full/x.toml"],
    "mission file that is a device": ["new", "/dev/zero"],
    "folder that is not there": ["new", "pond.csv", "--out", "none/x.toml"],
    "folder that is a device": ["campaign", "s.toml", "--out", "/dev/null"],
    "misspelt command": ["rum"],
}
