"""A platoon in SUMO behind a sinusoidal leader, run as a program: its libraries stay out of pytest.

Reads lists of types, ids, headways and frequency as JSON from standard input and prints a line for
each: the amplitudes of speed, leader first.
"""

import json
import sys
import tempfile
from pathlib import Path

import numpy as np

STEP, SPEED, SETTLE, DURATION, LENGTH, ROAD = 0.05, 20.0, 20.0, 300.0, 5.0, 30_000.0
NETWORK = f"""<net version="1.9">
<location netOffset="0,0" convBoundary="0,0,{ROAD},0" origBoundary="0,0,{ROAD},0"
  projParameter="!"/>
<edge id="road" from="a" to="b" priority="1">
  <lane id="road_0" index="0" speed="60" length="{ROAD}" shape="0,-1.6 {ROAD},-1.6"/></edge>
<junction id="a" type="dead_end" x="0" y="0" incLanes="" intLanes="" shape="0,0 0,-3.2"/>
<junction id="b" type="dead_end" x="{ROAD}" y="0" incLanes="road_0" intLanes=""
  shape="{ROAD},-3.2 {ROAD},0"/></net>"""


def start(folder: Path, types: str, ids: list[str], headways: list[float]) -> None:
    """The simulation with all vehicles in equilibrium."""
    import libsumo

    places = ROAD / 2 - np.cumsum([0.0, *(LENGTH + SPEED * headway for headway in headways)])
    vehicles = [
        f'<vehicle id="{k}" type="{kind}" route="along" depart="0" departPos="{place}"'
        f' departSpeed="{SPEED}"/>'
        for k, (kind, place) in enumerate(zip(["leader", *ids], places, strict=True))
    ]
    (folder / "road.net.xml").write_text(NETWORK)
    (folder / "types.add.xml").write_text(types, encoding="utf-8")
    (folder / "all.rou.xml").write_text(
        '<routes><vType id="leader" length="5" accel="10" decel="10" maxSpeed="100" speedDev="0"/>'
        f'<route id="along" edges="road"/>{"".join(vehicles)}</routes>'
    )
    libsumo.start(
        ["sumo", "-n", str(folder / "road.net.xml"), "-r", str(folder / "all.rou.xml"),
         "-a", str(folder / "types.add.xml"), "--step-length", str(STEP),
         "--step-method.ballistic", "--no-step-log", "--xml-validation", "never"]
    )  # fmt: skip
    libsumo.simulationStep()
    libsumo.vehicle.setSpeedMode("0", 0)


def amplitudes(count: int, frequency: float) -> list[float]:
    """Of speed in m/s over the last 200 s or so, in whole periods."""
    import libsumo

    instants = STEP * np.arange(1, round(DURATION / STEP))
    speeds = []
    for now in instants:
        phase = max(0.0, frequency * (now - SETTLE))
        libsumo.vehicle.setSpeed("0", SPEED + np.sin(phase))
        libsumo.simulationStep()
        speeds.append([libsumo.vehicle.getSpeed(str(k)) for k in range(count)])
    period = 2 * np.pi / frequency
    last = instants > DURATION - np.floor(200 / period) * period
    waves = [np.sin(frequency * instants), np.cos(frequency * instants), np.ones(len(instants))]
    found = np.linalg.lstsq(np.column_stack(waves)[last], np.array(speeds)[last], rcond=None)[0]
    libsumo.close()
    return [float(one) for one in np.hypot(found[0], found[1])]


if __name__ == "__main__":
    for types, ids, headways, frequency in json.load(sys.stdin):
        with tempfile.TemporaryDirectory() as name:
            start(Path(name), types, ids, headways)
            print(json.dumps(amplitudes(1 + len(ids), frequency)))
