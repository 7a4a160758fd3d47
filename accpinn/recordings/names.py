"""The name of a column taken apart: quantity, unit, leader or follower, vehicle's number.

Names are taken apart into words, as "precedingXVelocity" and "v lead [ft/s]" are; a unit stands in
brackets, behind an underscore, or in a row of its own.
"""

import re
from dataclasses import dataclass
from functools import cached_property

LEADER, FOLLOWER = "leader", "follower"
SPEED_ALIASES = {
    "m/s": "m/s", "mps": "m/s", "m/sec": "m/s", "ms-1": "m/s", "m s-1": "m/s", "m.s-1": "m/s",
    "km/h": "km/h", "kmh": "km/h", "kph": "km/h", "kmph": "km/h", "km/hr": "km/h", "km_h": "km/h",
    "mph": "mph", "mi/h": "mph", "miles/h": "mph",
    "ft/s": "ft/s", "fps": "ft/s", "ftps": "ft/s", "feet/s": "ft/s", "ft/sec": "ft/s",
    "kn": "kn", "kt": "kn", "kts": "kn", "knot": "kn", "knots": "kn",
}  # fmt: skip
LENGTH_ALIASES = {
    "m": "m", "meter": "m", "meters": "m", "metre": "m", "metres": "m",
    "ft": "ft", "feet": "ft", "foot": "ft", "cm": "cm", "mm": "mm", "km": "km",
}  # fmt: skip
_TIME_UNITS = frozenset(("s", "sec", "secs", "seconds", "ms", "us", "µs", "ns", "min", "h"))
_BRACKETS = re.compile(r"\s*[\[(]\s*([^\[\]()]*?)\s*[\])]\s*")
_WORDS = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[^\W\dA-Z_]+|\d+")
_JOINED = re.compile(
    r"(?P<d>d|x|dist|distance|v|vel|velocity|spd|speed)(?P<rel>rel)"
    r"|(?P<rel_>rel)(?P<of>d|x|dist|distance|v|vel|velocity|spd|speed)"
    r"|(?P<whose>.+?)s?(?P<what>geschwindigkeit|abstand|velocity|speed)"
)
"""Two words that are written as one: "vrel", "relvel" and German compounds."""

WORDS_OF = {
    "ignored": frozenset((
        "lat", "latitude", "lateral", "lon", "lng", "longitude", "alt", "altitude", "height",
        "width", "heading", "yaw", "angle", "slope", "jerk", "steer", "steering", "brake",
        "throttle", "pedal", "rpm", "maf", "torque", "gear", "temperature", "thw", "ttc", "limit",
        "setpoint", "set", "desired", "cmd", "command", "ref", "reference", "error", "std",
        "sigma", "variance", "quality", "count", "index", "type", "class", "angular",
    )),
    "acceleration": frozenset(("accel", "acceleration", "accer", "decel", "deceleration", "ax")),
    "relative": frozenset((
        "relative", "rel", "delta", "diff", "difference", "closing", "dv", "deltav", "rangerate",
        "rr", "dspeed", "relativgeschwindigkeit",
    )),
    "length": frozenset(("length", "len")),
    "travelled": frozenset((
        "travelled", "traveled", "cumulative", "odometer", "odo", "mileage", "driven",
    )),
    "position": frozenset(("position", "pos", "p", "x", "station", "chainage")),
    "speed": frozenset((
        "speed", "speeds", "velocity", "vel", "v", "spd", "geschwindigkeit", "vitesse",
        "velocidad", "velocità", "snelheid", "twist",
    )),
    "gap": frozenset((
        "gap", "gaps", "ivs", "clearance", "abstand", "distance", "dist", "range", "spacing",
        "separation", "interdistance", "distancia", "distanza", "afstand", "dx",
    )),
    "headway": frozenset(("headway", "dhw", "space")),
    "lane": frozenset(("lane",)),
    "id": frozenset(("id", "ids", "identifier", "vehicle", "veh", "track", "car")),
    "run": frozenset((
        "trajectory", "segment", "run", "trip", "scenario", "test", "experiment", "session",
        "recording", "drive", "case", "file",
    )),
    "mode": frozenset((
        "engaged", "acc", "cc", "mode", "driver", "autopilot", "active", "status", "enabled",
        "controller", "driven",
    )),
    "date": frozenset(("date", "day", "datum")),
}  # fmt: skip
"""Words, in small letters, for the quantity that a column holds."""
_SURE_GAPS = frozenset(("gap", "gaps", "ivs", "clearance", "abstand", "interdistance"))
_KNOWN: frozenset[str] = frozenset().union(*WORDS_OF.values())
_WHOSE = {
    LEADER: frozenset((
        "lead", "leader", "leading", "preceding", "precede", "predecessor", "prec", "front",
        "lv", "l", "ahead", "pv", "target", "tgt", "leadveh", "ziel", "vorderfahrzeug",
        "vorausfahrzeug", "führungsfahrzeug", "meneur", "líder", "lider",
    )),
    FOLLOWER: frozenset((
        "ego", "own", "host", "follower", "following", "follow", "foll", "subject", "fv", "fav",
        "f", "rear", "behind", "self", "eigen", "eigenes", "folgefahrzeug", "suiveur",
    )),
}  # fmt: skip


def _plain_unit(text: str) -> str:
    """A unit in small letters, with plain signs for dots and exponents."""
    plain = text.strip().casefold().replace("·", " ").replace("⁻¹", "-1").replace("^", "")
    return plain.replace("*", " ").replace("(", "").replace(")", "")


def _apart(word: str) -> tuple[str, ...]:
    """The words that a word in small letters is made of."""
    match = None if word in _KNOWN else _JOINED.fullmatch(word)
    return tuple(filter(None, match.groups())) if match else (word,)


@dataclass(frozen=True)
class ColumnName:
    """A column's name, taken apart."""

    name: str
    unit_cell: str = ""
    """The column's cell in a row of units; empty without such a row."""

    @cached_property
    def unit(self) -> str:
        """The unit as written, in small letters; empty without one."""
        if self.unit_cell.strip():
            return _plain_unit(self.unit_cell.strip(" []()"))
        for inside in reversed(_BRACKETS.findall(self.name)):
            unit = _plain_unit(inside)
            if unit in SPEED_ALIASES or unit in LENGTH_ALIASES or unit in _TIME_UNITS:
                return unit
        lowered = self.name.casefold()
        for alias in sorted((*SPEED_ALIASES, *LENGTH_ALIASES), key=len, reverse=True):
            if re.search(rf"[_ ,]{re.escape(alias)}\d*$", lowered):
                return alias
        if re.search(r"[_ ]ms$", lowered) and self.words & WORDS_OF["speed"]:
            return "m/s"
        return ""

    @cached_property
    def parts(self) -> tuple[str, ...]:
        """The words of the name in small letters, without its unit, numbers included."""
        base = self.name
        for inside in _BRACKETS.findall(base):
            if _plain_unit(inside) == self.unit:
                base = re.sub(r"[\[(]\s*" + re.escape(inside) + r"\s*[\])]", " ", base)
        if self.unit and not self.unit_cell:
            base = re.sub(rf"[_ ,]{re.escape(self.unit)}(\d*)$", r" \1", base, flags=re.IGNORECASE)
        return tuple(part for word in _WORDS.findall(base) for part in _apart(word.casefold()))

    @cached_property
    def words(self) -> frozenset[str]:
        """The words of the name, without numbers."""
        lowered = re.sub(r"\[[^\]]*\]|\d", " ", self.name)
        return frozenset(
            part for word in _WORDS.findall(lowered) for part in _apart(word.casefold())
        )

    def means(self, quantity: str) -> bool:
        """Whether a word of the name is one of those for a quantity."""
        return bool(WORDS_OF[quantity] & set(self.parts))

    @property
    def speed_unit(self) -> str:
        """The unit of speed, as mappings write it; empty where the name gives none."""
        return SPEED_ALIASES.get(self.unit, "")

    @property
    def length_unit(self) -> str:
        """The unit of length, as mappings write it; empty where the name gives none."""
        return LENGTH_ALIASES.get(self.unit, "")

    @cached_property
    def number(self) -> int | None:
        """The last number of the name."""
        numbers = [int(part) for part in self.parts if part.isdecimal() and len(part) < 4]
        return numbers[-1] if numbers else None

    @cached_property
    def whose(self) -> str:
        """`LEADER`, `FOLLOWER`, or empty where the name has no word for either."""
        parts = set(self.parts)
        for who, words in _WHOSE.items():
            if {word for word in words if len(word) > 1 or len(self.parts) <= 2} & parts:
                return who
        return ""

    @cached_property
    def quantity(self) -> str:
        """Key of `WORDS_OF` for the column's quantity; empty where the name does not give it.

        It is "ignored" for a time headway, a limit or another quantity that no mapping needs.
        """
        parts, is_short = set(self.parts), len(self.parts) <= 3
        if parts & {"time", "temporal"} and parts & {"gap", "headway", "collision"}:
            return "ignored"
        if {"range", "rate"} <= parts:
            return "relative"
        if parts & {"time", "timestamp", "timestamps"} and not self.speed_unit:
            if not self.means("speed") and not self.means("gap"):
                return "time"
        if self.speed_unit and not self.means("relative"):
            return "ignored" if self.means("ignored") else "speed"
        if self.means("relative") and not self.means("id"):
            is_speed = self.means("speed") or self.speed_unit or parts & {"dv", "deltav", "rr"}
            if is_speed or parts & {"rangerate", "closing", "dspeed"}:
                return "relative"
            return "gap" if self.means("gap") or (is_short and "d" in parts) else ""
        if self.means("ignored"):
            return "ignored"
        if self.means("acceleration"):
            return "acceleration"
        if self.means("id") and not parts & (WORDS_OF["speed"] | WORDS_OF["length"]) - {"v"}:
            if not self.means("gap") and not self.means("position"):
                return "lane" if self.means("lane") else "run" if self.means("run") else "id"
        if self.means("length"):
            return "length"
        if self.means("travelled"):
            return "position"
        if parts & _SURE_GAPS:
            return "gap"
        if parts & WORDS_OF["speed"] - {"v"}:
            return "speed"
        if parts & WORDS_OF["position"] and (is_short or parts & {"pos", "position"}):
            return "position"
        for quantity in ("headway", "gap", "speed", "lane", "run", "mode", "date"):
            if self.means(quantity):
                return quantity
        if self.whose == LEADER and is_short:
            return "id"
        return ""

    @property
    def is_sure_gap(self) -> bool:
        """Whether the name means a gap from bumper to bumper."""
        return bool(_SURE_GAPS & set(self.parts))

    @property
    def is_symbol(self) -> bool:
        """Whether the name consists of single letters, as "v_p"."""
        return all(len(part) == 1 for part in self.parts)
