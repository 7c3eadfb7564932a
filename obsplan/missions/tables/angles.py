"""Latitudes and longitudes as people write them: degrees, minutes, seconds, hemisphere letters."""

import re

from obsplan.missions.mission import check_number
from obsplan.types import ObsplanError

# 63°26'24"N, 63 26.4 N, N63-26.4, 63:26:24, -63.44°; minutes and seconds need a mark before them,
# so 6326.4 is none
_ANGLE = re.compile(
    r"""(?P<before>[NSEW])?\s*(?P<sign>[+-])?\s*(?P<degrees>\d{1,3}(?:\.\d*)?)\s*
    (?:[°:\s-]\s*(?P<minutes>\d{1,2}(?:\.\d*)?)\s*
    (?:[':\s-]\s*(?P<seconds>\d{1,2}(?:\.\d*)?)\s*)?)?
    [°'"]?\s*(?P<after>[NSEW])?""",
    re.ASCII | re.IGNORECASE | re.VERBOSE,
)
_PLAIN = re.compile(r"\s*[+-]?[\d.]+\s*", re.ASCII)
_MARKED = re.compile("[°º˚NSEW]", re.IGNORECASE)
_IN_LETTERS = re.compile(  # 63d26m24s, whose s is no south
    r"(\d+)\s*d(?:eg)?\s*(\d+(?:\.\d*)?)\s*m(?:in)?(?:\s*(\d+(?:\.\d*)?)\s*s(?:ec)?)?",
    re.ASCII | re.IGNORECASE,
)
_MARKS = str.maketrans({"º": "°", "˚": "°", "′": "'", "’": "'", "´": "'", "″": '"', "”": '"'})


def is_plain(text: str) -> bool:
    """Whether a text is a number, or no angle either, so that it is read as a number."""
    return _PLAIN.fullmatch(text) is not None or _match(text) is None


def is_marked(text: str) -> bool:
    """Whether a text is an angle with a letter of the compass or a sign of degrees."""
    return _MARKED.search(text) is not None and _match(text) is not None


def read_angle(text: str, where: str) -> tuple[float, str]:
    """Read an angle [degrees], and the letter N, S, E or W beside it; S and W make it negative.

    Raises
    ------
    ObsplanError
        Not an angle, minutes or seconds of 60 or more, or both a sign and a letter; names the
        place.
    """
    parts = _match(text)
    if parts is None:
        raise ObsplanError(
            f"{where} must be a number or degrees and minutes, got {text.strip()[:40]!r}: correct "
            "it"
        )
    letters = "".join(part for part in (parts["before"], parts["after"]) if part).upper()
    degrees = float(parts["degrees"])
    minutes, seconds = float(parts["minutes"] or 0), float(parts["seconds"] or 0)
    whole = degrees.is_integer() or parts["minutes"] is None
    whole = whole and (minutes.is_integer() or parts["seconds"] is None)
    if len(letters) > 1 or (letters and parts["sign"]) or not whole or max(minutes, seconds) >= 60:
        raise ObsplanError(
            f"{where} is no angle that can be, got {text.strip()[:40]!r}: write it as 63°26.4'N"
        )
    angle = degrees + minutes / 60 + seconds / 3600
    negative = parts["sign"] == "-" or letters in ("S", "W")
    return check_number(-angle if negative else angle, where), letters


def _match(text: str) -> re.Match[str] | None:
    """The parts of an angle."""
    plain = text.strip().translate(_MARKS).replace("''", '"')
    return _ANGLE.fullmatch(_IN_LETTERS.sub(_in_marks, plain))


def _in_marks(letters: re.Match[str]) -> str:
    """Degrees, minutes and perhaps seconds with marks in place of letters."""
    degrees, minutes, seconds = letters.groups()
    return f"{degrees}°{minutes}'" + (f'{seconds}"' if seconds else "")
